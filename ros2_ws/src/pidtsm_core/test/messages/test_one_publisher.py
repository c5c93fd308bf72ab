"""A node obeys the publisher that was there first, and no other while that one publishes."""

from collections.abc import Callable

import numpy as np
import pytest

from pidtsm_core.messages.one_publisher import OnePublisher

MS = 1_000_000
START = 5_000 * MS


class Reader:
    """Reads the messages of publishers at the times given."""

    def __init__(self) -> None:
        self.one, self.now = OnePublisher(), START
        self.publishers = 2

    def read(self, number: int, valid: bool = True) -> bool:
        accepted = self.one.accepts(number, self.now, lambda: self.publishers < 2)
        if accepted and valid:
            self.one.take(number, self.now)
        return accepted


@pytest.mark.parametrize("rate", [100, 1000, 5000])
@pytest.mark.parametrize("ahead", [1_000, 100_000, -900])
def test_of_two_publishers_the_first_is_obeyed(rate: int, ahead: int) -> None:
    """Whatever the number at which the second begins, also where messages of both are lost."""
    reader, random = Reader(), np.random.default_rng(rate)
    for number in range(1, 1001):
        assert reader.read(number)
        reader.now += 1000 * MS // rate
    for number in range(1001, 3000):
        if random.uniform() < 0.9:
            assert reader.read(number)
        if random.uniform() < 0.9:
            assert not reader.read(number + ahead)
        reader.now += 1000 * MS // rate
    assert reader.one.refused > 1700


def test_messages_of_the_only_publisher_are_read_whatever_is_lost() -> None:
    reader = Reader()
    reader.publishers = 1
    assert all(reader.read(number) for number in (1, 2, 500, 501, 100_000, 1, 2, 7))


def test_both_that_waited_while_the_receiver_did_not_run_are_distinguished() -> None:
    reader = Reader()
    assert all(reader.read(number) for number in range(1, 5000))
    reader.now += 5_000 * MS
    assert [reader.read(number) for number in (100, 5000, 101, 5001)] == [False, True, False, True]


def test_another_is_obeyed_when_the_first_has_been_silent() -> None:
    reader = Reader()
    assert all(reader.read(number) for number in range(1, 5000))
    accepted = []
    for number in range(1, 300):
        accepted.append(reader.read(number))
        reader.now += MS
    assert accepted == [False] * 101 + [True] * 198
    assert not reader.read(5000)


@pytest.mark.parametrize("before", [lambda reader: None, lambda reader: reader.read(1)], ids=["at first", "later"])
def test_a_publisher_of_invalid_messages_is_never_obeyed(before: Callable[[Reader], object]) -> None:
    reader = Reader()
    before(reader)
    for number in range(10_000, 10_500):
        reader.read(number, valid=False)
        reader.now += MS
    assert reader.read(1) or reader.read(2)
