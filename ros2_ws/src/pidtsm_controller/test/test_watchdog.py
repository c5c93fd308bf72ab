"""The silence of joint states is that of the arm, not that of a controller that could not listen."""

import time

import pytest

from pidtsm_controller.watchdog import CHECK, Watchdog

NANOSECONDS = 10**9


class Clock:
    """A clock that the test sets, s."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> int:
        return round(self.now * NANOSECONDS)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic_ns", clock)
    return clock


def test_silence_grows_from_the_last_joint_state_on(clock: Clock) -> None:
    watchdog = Watchdog()
    watchdog.silence()
    watchdog.received()
    for check in range(1, 11):
        clock.now = 100.0 + check * CHECK
        assert watchdog.silence() == watchdog.age == round(check * CHECK * NANOSECONDS)


def test_a_process_that_was_suspended_listens_first(clock: Clock) -> None:
    watchdog = Watchdog()
    watchdog.silence()
    watchdog.received()
    clock.now = 103.0
    assert watchdog.silence() == 0
    assert watchdog.age == 3 * NANOSECONDS
    clock.now += CHECK
    assert watchdog.silence() == round(CHECK * NANOSECONDS)
