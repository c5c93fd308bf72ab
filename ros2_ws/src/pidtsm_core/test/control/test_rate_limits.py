"""Rate limits of the torque in the closed loop: the arm follows as far as they permit, and never runs away."""

import math
from typing import Any

import numpy as np
import pytest
from support.testarms import ARMS, TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Limited, Signal, Status

DT = 0.001
ENCODERS: dict[str, Any] = {"encoder.bits": 14, "delay.samples": 1}
SETS = pytest.mark.parametrize("name", ["default", "practical"])


def roll(
    arm: Arm, name: str, rates: Array, duration: float, limits: Array | None = None, **simulator: Any
) -> Recording:
    """Run the motion of the arm with a set of parameters; ``practical`` with the sensors for which it is intended."""
    settings = arm.motion()
    if name == "practical":
        settings["controller"] |= arm.practical
        settings["simulator"] |= ENCODERS
    settings["controller"]["limits.effort_rate"] = rates.tolist()
    if limits is not None:
        settings["controller"]["limits.effort"] = limits.tolist()
    settings["simulator"] |= simulator
    return rollout(**settings, duration=duration)


def errors(run: Recording) -> Array:
    """|e|, shape (samples, joints), rad."""
    return np.abs(run.position - run.reference[:, 0])


def limited(run: Recording, by: Limited) -> Array:
    """Number of samples with a limited torque, shape (joints,)."""
    return (run.signals[:, Signal.SATURATED].astype(int) & by != 0).sum(axis=0)


@SETS
@pytest.mark.parametrize("share", [10.0, 3.0, 1.0])
def test_the_arm_follows_its_reference_with_a_torque_that_keeps_within_the_rate(
    arm: Arm, name: str, share: float
) -> None:
    rates, settled = share * arm.limits, 10.0 if arm is TWO_LINK else 4.0
    run = roll(arm, name, rates, settled + 2.0)
    assert not run.status[:, Status.FAULT].any()
    assert (np.abs(np.diff(run.signals[:, Signal.EFFORT], axis=0)) <= rates * DT + 1e-9).all()
    # The noise of encoders alone demands more of a light joint than the lowest rate.
    noisy = name == "practical" and share == 1.0 and arm is not TWO_LINK
    assert errors(run)[run.time >= settled].max() <= (5e-3 if noisy else 1e-3)
    # On its way, the arm never moves away from the reference.
    assert (errors(run).max(axis=0) <= errors(run)[0] + 0.01).all()


@pytest.mark.parametrize(
    ("arm", "name"), [(TWO_LINK, "default"), *((arm, "practical") for arm in ARMS)], indirect=["arm"], ids=str
)
@pytest.mark.parametrize("strength", [0.97, 1.0, 1.03])
def test_a_push_that_brings_torque_and_rate_to_their_limits_is_over_soon(arm: Arm, name: str, strength: float) -> None:
    """Pushes of slightly different strength: where limits meet, small causes have large effects.

    The torque of the last joint and the rates of all reach their limits; of many joints, the last are slow to do so.
    """
    limits, push = arm.limits.copy(), np.array([120.0, -40.0])
    if arm is not TWO_LINK:
        limits[-1] = arm.weak_limits(4.0)[-1]
        push = arm.effort(arm.start, ddq=arm.alternating(5.0)) - arm.effort(arm.start)
    pushed = {"push.effort": (strength * push).tolist(), "push.time": 5.0, "push.duration": 0.3}
    run = roll(arm, name, 3.0 * arm.limits * arm.spread(1.0, 2.0 if arm.joints <= 3 else 0.6), 10.0, limits, **pushed)
    assert limited(run, Limited.EFFORT)[-1] > 0
    assert (limited(run, Limited.RATE) > 0).all()
    assert not run.status[:, Status.FAULT].any()
    assert errors(run)[run.time >= 5.0].max() > 0.01
    assert errors(run)[run.time >= 7.3].max() < 0.02


def test_a_rate_that_is_too_tight_ends_in_a_fault_with_the_arm_at_rest(arm: Arm) -> None:
    settings = arm.motion()
    tight = {"limits.effort_rate": (0.05 * arm.limits).tolist()}
    settings["controller"] |= {"law.name": "pid", **arm.gains("pid"), **tight}
    run = rollout(**settings, duration=30.0)
    assert run.status[-1, Status.FAULT] == Fault.EFFORT_RATE_LIMIT
    assert np.abs(run.velocity[-1]).max() < 0.05
    assert errors(run).max() < math.pi


@SETS
@pytest.mark.parametrize("time", [0.3, 5.0])
def test_a_push_during_or_after_the_approach_keeps_the_rate_limit(arm: Arm, name: str, time: float) -> None:
    """The push comes while the arm is still on its way to the reference, or later."""
    push = arm.effort(arm.start, ddq=3.0) - arm.effort(arm.start)
    rates = 3.0 * arm.limits * arm.spread(1.0, 2.0)
    pushed = {"push.effort": push.tolist(), "push.time": time, "push.duration": 0.2}
    run = roll(arm, name, rates, time + 4.0, **pushed)
    assert (np.abs(np.diff(run.signals[:, Signal.EFFORT], axis=0)) <= rates * DT + 1e-9).all()
    assert not run.status[:, Status.FAULT].any()
    assert errors(run)[-1000:].max() < 0.02


def carried(arm: Arm) -> list[str]:
    """The joints on which gravity acts."""
    random = np.random.default_rng(0)
    efforts = np.abs([arm.effort(random.uniform(-1.0, 1.0, arm.joints)) for _ in range(10)])
    return [name for name, effort in zip(arm.names, efforts.max(axis=0), strict=True) if effort > 1e-9]


@pytest.mark.parametrize(
    ("first", "others", "named"),
    [
        (0.0, 0.0, slice(0)),
        (10.0, 10.0, slice(0)),
        (1e-3, 1e-3, slice(None)),
        (1e-3, 10.0, slice(1)),
        (0.0, 1e-3, slice(1, None)),
    ],
)
def test_a_rate_limit_that_lets_a_joint_fall_causes_a_warning(
    arm: Arm, first: float, others: float, named: slice
) -> None:
    """The rates are shares of the limits."""
    rates = arm.limits * [first, *[others] * (arm.joints - 1)]
    warnings = arm.controller(limits__effort_rate=rates.tolist()).warnings()
    expected = [name for name in arm.names[named] if name in carried(arm)]
    assert [warning.split()[2] for warning in warnings] == expected
    for name, warning in zip(expected, warnings, strict=True):
        place = arm.names.index(name)
        unit = arm.robot.units[place].effort
        assert warning.startswith(f"limits.effort_rate of {name} is {rates[place]:g} {unit}/s: ")


def test_the_rate_in_the_warning_is_enough_and_hardly_more_than_needed(arm: Arm) -> None:
    def warned(rate: float) -> bool:
        return any(last in warning for warning in arm.controller(limits__effort_rate=[*loose, rate]).warnings())

    last, loose = arm.names[-1], (10.0 * arm.limits[:-1]).tolist()
    (warning,) = arm.controller(limits__effort_rate=[*loose, 1e-6]).warnings()
    least = float(warning.split("at least ")[1].split()[0])
    assert not warned(1.06 * least)
    assert warned(0.94 * least)
