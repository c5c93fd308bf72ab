"""Events of a run are reported correctly, as numbers for programs and as text for people."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.experiment import Experiment
from pidtsm_core.recording import Recording
from pidtsm_core.recording.outcome import SHARE_OF_RANGE, what_happened, why_not_followed
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status, Violation

STOPPED = (Mode.STOPPED, Fault.TRACKING_LIMIT, 2, Violation.TRACKING)
WIDER = {"velocity": (4,), "effort": (4,), "reference": (3, 4), "signals": (len(Signal), 4)}
"""Shapes of the arrays of an arm with four joints, by sample."""
HOLDING = (Mode.HOLDING, 0, 0, 0)


def recording(run: Recording, *statuses: tuple[slice, tuple[int, ...]], **changed: Any) -> Recording:
    """Two seconds at 1 kHz in which the controller has these statuses."""
    status = np.zeros((len(run.time), len(Status)), dtype=np.uint8)
    for where, codes in statuses:
        status[where, : len(codes)] = codes
    signals = run.signals.copy()
    signals[:, Signal.SATURATED] = 0.0  # At first it is.
    return replace(run, **{"status": status, "signals": signals, **changed})


def test_a_run_that_follows_has_no_events(run: Recording) -> None:
    values = recording(run).metrics()
    assert values["outcome"] == "followed"
    assert (values["faults"], values["violations"]) == ([], [])
    assert (values["time_holding"], values["time_stopped"]) == (0.0, 0.0)
    assert values["rejected"] is None
    assert what_happened(values) == []
    assert why_not_followed(values) == ""


def test_a_fault_is_reported_with_joint_and_time(run: Recording) -> None:
    values = recording(run, (slice(123, None), STOPPED)).metrics()
    assert values["outcome"] == "stopped"
    assert values["faults"] == [
        {"fault": "tracking_limit", "time": 0.123, "joint": "joint2", "reset": None, "limited": []}
    ]
    assert values["time_stopped"] == pytest.approx(2.0 - 0.123)
    assert why_not_followed(values) == "stopped at 0.123 s: joint2 is beyond limits.tracking_error"
    assert why_not_followed(values) in what_happened(values)


@pytest.mark.parametrize(("samples", "named"), [(90, False), (110, True)])
def test_a_fault_names_the_joint_that_had_been_at_its_effort_limit(run: Recording, samples: int, named: bool) -> None:
    recorded = recording(run, (slice(600, None), STOPPED))
    recorded.signals[500 - samples : 500, Signal.SATURATED, 0] = Limited.EFFORT
    values = recorded.metrics()
    assert values["faults"][0]["limited"] == (["joint1"] if named else [])
    assert why_not_followed(values).endswith("after joint1 had been at the effort limit") == named


def test_faults_that_were_reset_are_reported_and_forgiven(run: Recording) -> None:
    lost = (Mode.STOPPED, Fault.STATE_STALE, 0, 0)
    values = recording(run, (slice(100, 200), lost), (slice(300, 350), STOPPED)).metrics()
    assert values["outcome"] == "followed"
    assert values["faults"] == [
        {"fault": "state_stale", "time": 0.1, "joint": None, "reset": 0.2, "limited": []},
        {"fault": "tracking_limit", "time": 0.3, "joint": "joint2", "reset": 0.35, "limited": []},
    ]
    assert why_not_followed(values) == ""
    events = what_happened(values)
    assert "stopped at 0.1 s: no joint state; reset at 0.2 s" in events
    assert "stopped for 0.15 s of 2 s" in events


def test_a_fault_that_replaces_another_is_reported_too(run: Recording) -> None:
    too_tight = (Mode.STOPPED, Fault.EFFORT_RATE_LIMIT, 0, 0)
    values = recording(run, (slice(100, 110), STOPPED), (slice(110, None), too_tight)).metrics()
    assert [(fault["fault"], fault["time"]) for fault in values["faults"]] == [
        ("tracking_limit", 0.1),
        ("effort_rate_limit", 0.11),
    ]
    assert why_not_followed(values).startswith("stopped at 0.11 s: limits.effort_rate is too tight")


def test_a_fault_counts_from_its_sample_although_the_mode_follows_later(run: Recording) -> None:
    values = recording(run, (slice(1999, None), (Mode.FOLLOWING, Fault.POSITION_LIMIT, 1, 1))).metrics()
    assert values["outcome"] == "stopped"
    assert values["time_stopped"] == 0.001


def test_a_fault_of_another_version_is_reported_by_its_number(run: Recording) -> None:
    values = recording(run, (slice(5, None), (Mode.STOPPED, 77, 9, 0))).metrics()
    assert values["faults"] == [{"fault": "fault_77", "time": 0.005, "joint": None, "reset": None, "limited": []}]
    assert "stopped at 0.005 s: fault_77" in what_happened(values)


def test_holding_at_the_end_is_no_success(run: Recording) -> None:
    values = recording(run, (slice(500, 600), HOLDING), (slice(1900, None), HOLDING)).metrics()
    assert values["outcome"] == "held"
    assert values["time_holding"] == 0.2
    assert "holds its position" in why_not_followed(values)
    assert "holding for 0.2 s of 2 s" in what_happened(values)


def test_violations_are_reported_with_their_time(run: Recording) -> None:
    both = (0, 0, 0, Violation.POSITION | Violation.VELOCITY)
    values = recording(run, (slice(100, 150), both), (slice(200, 210), (0, 0, 0, Violation.VELOCITY))).metrics()
    assert values["violations"] == [
        {"limit": "position", "time": 0.1, "duration": 0.05},
        {"limit": "velocity", "time": 0.1, "duration": 0.06},
    ]
    assert "a joint was beyond limits.velocity for 0.06 s, first at 0.1 s" in what_happened(values)
    assert values["outcome"] == "followed"


def off(run: Recording, joint: int, error: float, samples: slice) -> Recording:
    """The run with an error of one joint."""
    position = run.reference[:, 0].copy()
    position[samples, joint] += error
    return recording(run, position=position)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize(("share", "outcome"), [(0.99, "followed"), (1.01, "strayed")])
def test_a_run_that_strays_by_more_than_a_share_of_the_range_has_not_followed(
    run: Recording, joint: int, share: float, outcome: str
) -> None:
    """Without limits, the range is a turn."""
    error = share * SHARE_OF_RANGE * 2.0 * np.pi
    values = off(run, joint, error, slice(700, 701)).metrics()
    assert values["outcome"] == outcome
    expected = (
        f"strayed: joint{joint + 1} was {error:.3g} rad from its reference at 0.7 s, 15 % of its range; a run with"
    )
    assert why_not_followed(values).startswith(expected if outcome == "strayed" else "")
    assert what_happened(values) == ([why_not_followed(values)] if outcome == "strayed" else [])


def test_an_arm_may_begin_far_from_its_reference(run: Recording) -> None:
    assert off(run, 0, 1.5, slice(0, 300)).metrics()["outcome"] == "followed"


def test_the_range_is_that_of_the_description(run: Recording) -> None:
    """Of a joint that slides."""
    robot = find_robot({"robot.description": "scara"})
    joint = robot.slides.index(True)
    low, high = robot.position_limits[joint]
    begin = run.reference[:, 0, :1] * np.zeros(4)
    for share, outcome in ((0.99, "followed"), (1.01, "strayed")):
        position = begin.copy()
        position[500:, joint] = share * SHARE_OF_RANGE * (high - low)
        wider = {name: np.zeros((len(run.time), *shape)) for name, shape in WIDER.items()}
        values = recording(
            run,
            **wider,
            position=position,
            joints=robot.joints,
            slides=robot.slides,
            robot={"robot.description": "scara"},
        ).metrics()
        assert values["outcome"] == outcome


def test_an_error_beyond_half_a_turn_always_counts_as_running_away(run: Recording) -> None:
    position = run.position.copy()
    position[700, 1] += 3.2
    values = recording(run, (slice(800, None), STOPPED), position=position).metrics()
    assert values["outcome"] == "ran away"
    assert why_not_followed(values).startswith("ran away")
    assert what_happened(values)[0] == why_not_followed(values)
    assert max(values["rmse"]) > 0.0


@pytest.mark.parametrize(
    ("slides", "unit"), [((), "rad"), ((False, True), "rad or m"), ((True, True), "m")], ids=("turn", "both", "slide")
)
def test_the_units_are_those_of_the_joints(run: Recording, slides: tuple[bool, ...], unit: str) -> None:
    values = recording(run, position=run.position + 4.0, slides=slides).metrics()
    assert values["slides"] == list(slides or (False, False))
    assert f"more than 3.14 {unit} from" in why_not_followed(values)


def test_a_rollout_knows_its_arm() -> None:
    settings = {"robot.description": "scara", "joints": ["joint3", "joint1", "joint2"]}
    swing = {"reference.name": "sines", "reference.amplitude": 0.0}
    nodes: dict[str, dict[str, Any]] = {"simulator": settings, "controller": settings, "trajectory": swing}
    kept = rollout(Experiment("at rest", "", 0.01, nodes))
    assert (kept.slides, kept.continuous) == ((True, False, False), (False, False, False))
    assert dict(kept.robot)["robot.description"] == "scara"


def test_limits_of_effort_and_rate_are_distinguished(run: Recording) -> None:
    signals = run.signals.copy()
    signals[:, Signal.SATURATED] = 0.0
    signals[100:150, Signal.SATURATED, 0] = Limited.EFFORT
    signals[150:160, Signal.SATURATED, 0] = Limited.EFFORT + Limited.RATE
    signals[160:170, Signal.SATURATED, 1] = Limited.RATE
    values = recording(run, signals=signals).metrics()
    assert values["time_at_effort_limit"] == [0.06, 0.0]
    assert values["time_at_rate_limit"] == [0.01, 0.01]
    assert values["saturation"] == [0.03, 0.005]


def test_torque_variation_per_second_is_comparable_across_rates() -> None:
    slow, fast = (rollout(simulator={"rate": rate}, duration=2.0).metrics() for rate in (500, 1000))
    for one, other in zip(slow["torque_variation_rate"], fast["torque_variation_rate"], strict=True):
        assert one == pytest.approx(other, rel=0.1)
    period = 1.999 / 1999
    assert fast["torque_variation_rate"] == pytest.approx([v / period for v in fast["torque_variation"]])


def test_rejected_messages_are_reported_by_node(run: Recording) -> None:
    values = recording(run, rejected={"controller": 3, "simulator": 0}).metrics()
    assert values["rejected"] == {"controller": 3, "simulator": 0}
    assert what_happened(values) == ["messages rejected: controller 3"]


def test_a_rollout_reports_the_same_events_as_its_nodes() -> None:
    """The status is that of a real run."""
    run = rollout(
        controller={"limits.tracking_error": 0.45, "rehearsal.reset_fault": 0.4, "activation.blend": 0.5},
        trajectory={"jump.time": 0.3, "jump.position": [0.0, 0.5]},
        duration=0.6,
    )
    values = run.metrics()
    assert values["outcome"] == "followed"
    (fault,) = values["faults"]
    assert (fault["fault"], fault["joint"], fault["time"], fault["reset"]) == ("tracking_limit", "joint2", 0.3, 0.4)
