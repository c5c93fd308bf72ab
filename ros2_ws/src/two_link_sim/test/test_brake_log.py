"""Frequent changes of the brakes are logged once, and the last log line shows their final state."""

import time

import pytest

from two_link_sim.brake_log import CALM, BrakeLog


@pytest.fixture
def at(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in its only element, s."""
    at = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: at[0])
    return at


def test_each_change_after_a_calm_time_is_logged(at: list[float]) -> None:
    log = BrakeLog()
    for engaged in (True, False, True, False):
        assert log.changes(engaged)
        assert not log.changes(engaged)
        assert log.engaged is engaged
        at[0] += 1.1 * CALM
    assert log.count == 2


def test_of_fluttering_brakes_the_first_and_the_last_change_are_logged(at: list[float]) -> None:
    log, logged = BrakeLog(), []
    for k in range(3001):
        at[0] += 1e-3
        engaged = k < 1001 and k % 2 == 0
        if log.changes(engaged):
            logged.append((k, engaged))
    assert logged[0] == (0, True)
    assert [engaged for _, engaged in logged] == [True, False]
    assert logged[1][0] == pytest.approx(1001 + 1000 * CALM, abs=2)
    assert log.count == 501
