"""The judge of stops finds what is bad, and only that."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.stopcases import ARMS, Case, case_of, ordinary_case_of
from support.stopcauses import Event
from support.stopjudge import CRITERIA, judge, released
from support.stoploop import STEP, Braking, brake
from support.stoprun import Run
from support.stopwhy import CHOICES, CONDITIONS, LIMITS, explain
from support.testarms import ROTOR

GOOD = Case(
    seed=0,
    index=0,
    arm="two_link",
    cause="velocity limit",
    blind=False,
    kind={},
    controller={"limits.velocity": 0.3, "law.name": "computed_torque", "activation.blend": 0.0},
    simulator={"rate": 500, "initial_position": [-0.2, -0.3], "disturbance.name": "none", "command.timeout": 0.0},
    trajectory={
        "reference.name": "sines",
        "reference.amplitude": 0.2,
        "reference.frequency": 0.3,
        "reference.phase": -0.5 * np.pi,
        "reference.offset": [0.0, -0.1],
    },
    events=[],
    until=1.0,
    after=2.0,
)
"""The arm swings, faster than its limit allows."""


def drift(run: Run) -> None:
    run.trace.position[run.stopped :, 0] += np.linspace(0.0, 0.2, len(run.trace.fault) - run.stopped)


def hurry(run: Run) -> None:
    run.trace.velocity[run.stopped + 100, 1] = 1.0


def swing_up(run: Run) -> None:
    """Slowly enough that it is no faster than allowed, and around where it rests, near enough."""
    rows = np.arange(len(run.trace.fault) - run.stopped)[250:500]
    run.trace.velocity[run.stopped + rows, :] = np.sin(np.pi * np.linspace(0.0, 1.0, rows.size))[:, np.newaxis] * 0.55


def jolt(run: Run) -> None:
    run.trace.command[run.stopped + 50 :, 0] += 1.5 * STEP * run.limit[0]


def overload(run: Run) -> None:
    ramp = np.minimum(np.arange(len(run.trace.fault) - run.stopped) * 0.01, 1.2)
    run.trace.command[run.stopped :, 1] = ramp * run.limit[1]


def break_down(run: Run) -> None:
    run.finite = False


SPOILT: dict[str, Callable[[Run], None]] = {
    "travel": drift,
    "speed": hurry,
    "energy": swing_up,
    "step": jolt,
    "torque": overload,
    "finite": break_down,
}


def without(names: list[str]) -> Callable[[Run], None]:
    """Take conditions away, in their order."""

    def change(run: Run) -> None:
        for name, (take_away, _) in (CONDITIONS | CHOICES).items():
            if name in names:
                take_away(run)

    return change


def test_a_good_stop_violates_nothing() -> None:
    outcome = judge(Run(GOOD))
    assert outcome.fault == "VELOCITY_LIMIT"
    assert outcome.why == []
    assert 0.0 < outcome.worst["travel"] <= 1.0


@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_stop_that_is_spoilt_violates_its_criterion(criterion: str) -> None:
    run = Run(GOOD)
    SPOILT[criterion](run)
    outcome = judge(run)
    assert outcome.worst[criterion] > 1.0
    assert any(reason.startswith(criterion) for reason in outcome.why)


@pytest.mark.parametrize("make", [case_of, ordinary_case_of])
def test_a_case_follows_from_seed_and_index_and_survives_as_text(make: Callable[[int, int], Case]) -> None:
    cases = [make(7, index) for index in range(40)]
    assert [make(7, index).text for index in range(40)] == [case.text for case in cases]
    assert [Case.from_text(case.text) for case in cases] == cases
    assert len({case.text for case in cases}) == len(cases)


@pytest.mark.parametrize("rate", [100, 1000])
def test_the_best_braking_takes_the_known_way(rate: int) -> None:
    """A rotor from 3 rad/s, which already brakes, and one whose torque must change first."""
    arm = ARMS["pendulum"]
    speed, most = 3.0, arm.limits[0] / ROTOR
    for torque, ramp in ((-arm.limits[0], 0.0), (0.0, 1.0 / STEP / rate)):
        way, fastest = np.zeros(1), np.zeros(1)
        state = np.array([[0.3], [speed], [torque]])
        brake(arm.free, Braking(arm.limits, STEP, 1.0 / rate, 0), state, way, fastest, np.zeros((7, 1)))
        # On a ramp from 0, the mean deceleration is half of the largest.
        after = speed - 0.5 * most * ramp
        expected = speed * ramp - most * ramp**2 / 6.0 + after**2 / (2.0 * most)
        assert way[0] == pytest.approx(expected, rel=0.02 + 20.0 / rate)
        assert fastest[0] == pytest.approx(speed)


def test_a_load_that_is_picked_up_after_a_stop_is_a_force_from_outside() -> None:
    picked = Run(replace(GOOD, simulator=GOOD.simulator | {"payload.mass": 1.0, "payload.time": 1.5}))
    stretches = list(picked.stretches())
    assert [stretch.start for stretch in stretches] == [picked.stopped, round(1.5 / picked.dt)]
    assert not released(picked, stretches[0].start).any()
    assert released(picked, stretches[1].start).max() > 1.0


@pytest.mark.parametrize(
    ("events", "simulator", "explanation"),
    [
        ([("LOSS", 0, 0.3, 100.0, 0.0)], {}, "outage"),
        ([("FROZEN", 0, 0.3, 100.0, 0.0)], {}, "lie"),
        ([], {"payload.mass": 4.0}, "load"),
        ([], {"limits.effort": [12.0, 4.0]}, LIMITS),
    ],
    ids=["outage", "lie", "load", "limits"],
)
def test_a_bad_stop_is_explained_by_what_makes_it_bad(
    events: list[Event], simulator: dict[str, object], explanation: str
) -> None:
    run = Run(replace(GOOD, events=events, simulator=GOOD.simulator | simulator))
    assert judge(run).why
    assert explain(run) == explanation


def test_a_bad_stop_is_explained_by_conditions_that_are_all_needed() -> None:
    run = Run(case_of(1, 136))  # Both encoders stand still, and the arm carries a load.
    explanation = explain(run).split("+")
    assert len(explanation) > 1
    assert not judge(run.with_other(without(explanation))).why
    for name in explanation:
        assert judge(run.with_other(without([other for other in explanation if other != name]))).why


def test_a_run_continues_at_a_faster_rate() -> None:
    run = Run(GOOD)
    faster = run.with_other(lambda other: other.change_rate(1000))
    assert faster.dt == pytest.approx(0.5 * run.dt)
    np.testing.assert_allclose(faster.trace.position[::2], run.trace.position, atol=1e-3)
    assert not judge(faster).why
    np.testing.assert_array_equal(run.with_other(lambda _: None).trace.position, run.trace.position)


def test_a_stop_continues_from_another_command() -> None:
    run = Run(GOOD)
    effort = run.trace.command[run.stopped] + 0.3 * run.limit
    other = run.with_other(lambda other: other.replace_last_command(effort))
    np.testing.assert_array_equal(other.trace.command[run.stopped], effort)
    step = np.abs(other.trace.command[run.stopped + 1] - effort) / run.limit
    assert (step > 0.0).all()
    assert (step <= STEP).all()


def test_a_run_continues_from_its_stop_as_often_as_one_likes() -> None:
    run = Run(GOOD)
    again = [run.with_other(lambda _: None) for _ in range(2)]
    for other in again:
        np.testing.assert_array_equal(other.trace.position, run.trace.position)
        np.testing.assert_array_equal(other.trace.command, run.trace.command)


CURED = [Case.from_text(line) for line in (Path(__file__).parent / "cured_stops.jsonl").read_text().splitlines()]
"""Stops that once were worse than what they stopped, as the random search found them."""


@pytest.mark.parametrize("case", CURED, ids=lambda case: f"{case.index} {case.arm} {case.cause}")
def test_stops_that_were_bad_are_good(case: Case) -> None:
    judged = judge(Run(case))
    assert judged.stopped
    assert judged.worst_ratio <= 1.0, judged.why
