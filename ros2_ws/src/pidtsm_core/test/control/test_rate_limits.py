"""Rate limits of the torque in the closed loop: the arm follows as far as they permit, and never runs away."""

import math
from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.parameters import Array, resolve
from pidtsm_core.rollout import Rollout, rollout
from pidtsm_core.signals import Fault, Limited, Signal, Status

DT = 0.001
ENCODERS: dict[str, Any] = {"encoder.bits": 14, "delay.samples": 1}
SETS = pytest.mark.parametrize("name", ["default", "practical"])


def roll(name: str, practical: dict[str, Any], rate: float, duration: float, **push: Any) -> Rollout:
    """Run Case 1 with this set of parameters; ``practical`` with the sensors for which it is intended."""
    controller, simulator = (practical, ENCODERS) if name == "practical" else ({}, {})
    return rollout(
        {"controller": {**controller, "limits.effort_rate": rate}, "simulator": {**simulator, **push}}, duration
    )


def errors(run: Rollout) -> Array:
    """|e|, shape (samples, joints), rad."""
    return np.abs(run.position - run.reference[:, 0])


def limited(run: Rollout, by: Limited) -> Array:
    """Number of samples with a limited torque, shape (joints,)."""
    return (run.signals[:, Signal.SATURATED].astype(int) & by != 0).sum(axis=0)


@SETS
@pytest.mark.parametrize("rate", [1000.0, 300.0, 100.0])
def test_the_arm_follows_its_reference_with_a_torque_that_keeps_within_the_rate(
    name: str, rate: float, practical: dict[str, Any]
) -> None:
    run = roll(name, practical, rate, 30.0)
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(np.diff(run.signals[:, Signal.EFFORT], axis=0)).max() <= rate * DT + 1e-9
    assert errors(run)[run.time >= 10.0].max() <= 1e-3
    # On its way, the arm never moves away from the reference.
    assert (errors(run).max(axis=0) <= errors(run)[0] + 0.01).all()


@SETS
def test_a_push_that_brings_torque_and_rate_to_their_limits_is_over_soon(name: str, practical: dict[str, Any]) -> None:
    push = {"push.effort": [120.0, -40.0], "push.time": 10.0, "push.duration": 0.3}
    run = roll(name, practical, 300.0, 15.0, **push)
    assert limited(run, Limited.EFFORT)[1] > 0
    assert (limited(run, Limited.RATE) > 0).all()
    assert not run.status[:, Status.FAULT].any()
    assert errors(run).max() > 0.1
    assert errors(run)[run.time >= 12.3].max() < 0.02


def test_a_rate_that_is_too_tight_ends_in_a_fault_with_the_arm_at_rest() -> None:
    run = rollout({"controller": {"law.name": "pid", "limits.effort_rate": 5.0}}, 30.0)
    assert run.status[-1, Status.FAULT] == Fault.EFFORT_RATE_LIMIT
    assert np.abs(run.velocity[-1]).max() < 0.05
    assert errors(run).max() < math.pi


@SETS
@pytest.mark.parametrize("time", [0.3, 5.0])
def test_a_push_during_or_after_the_approach_keeps_the_rate_limit(
    name: str, time: float, practical: dict[str, Any]
) -> None:
    """The push comes while the arm is still on its way to the reference, or later."""
    run = roll(
        name, practical, 300.0, time + 4.0, **{"push.effort": [40.0, 20.0], "push.time": time, "push.duration": 0.2}
    )
    assert np.abs(np.diff(run.signals[:, Signal.EFFORT], axis=0)).max() <= 300.0 * DT + 1e-9
    assert not run.status[:, Status.FAULT].any()
    assert errors(run)[-1000:].max() < 0.02


def controller_of(**changes: object) -> Controller:
    """A controller; parameter names with two underscores instead of the dot."""
    return Controller(resolve(controller_schema, {n.replace("__", "."): v for n, v in changes.items()}, 2))


@pytest.mark.parametrize(
    ("rate", "named"),
    [
        (0.0, []),
        (100.0, []),
        (5.0, ["joint1", "joint2"]),
        ([5.0, 100.0], ["joint1"]),
        ([0.0, 5.0], ["joint2"]),
    ],
)
def test_a_rate_limit_that_lets_a_joint_fall_causes_a_warning(rate: object, named: list[str]) -> None:
    warnings = controller_of(limits__effort_rate=rate).warnings()
    assert [warning.split()[2] for warning in warnings] == named
    for warning in warnings:
        assert warning.startswith("limits.effort_rate of joint")
        assert "is 5 N m/s: " in warning


def test_the_rate_in_the_warning_is_enough_and_hardly_more_than_needed() -> None:
    warning, _ = controller_of(limits__effort_rate=1.0).warnings()
    least = float(warning.split("at least ")[1].split()[0])
    assert not any("joint1" in w for w in controller_of(limits__effort_rate=1.06 * least).warnings())
    assert any("joint1" in w for w in controller_of(limits__effort_rate=0.94 * least).warnings())
