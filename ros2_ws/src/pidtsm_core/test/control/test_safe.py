"""A controller that has stopped holds the arm, even if its model is wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.testarms import ARMS, Arm

from pidtsm_core.control import Condition
from pidtsm_core.laws import LAWS
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Mode, Signal, Status

MS = 1_000_000
STEP = 0.1
"""Largest permitted change of a torque between two commands, as a share of its limit."""
STILL = 0.25e-3
"""Largest motion of an arm that is held in 1 s, rad or m."""
SILENCES = [(100, 300), (250, 100), (250, 2000), (500, 300), (1000, 100), (1000, 2000)]
"""Rate, Hz, and duration, ms."""
DRAWN_IN = 4000
"""ms after which the integrals compensate the error of the model."""


def limit(name: str, value: float) -> Callable[[Any], None]:
    def cause(loop: Any) -> None:
        loop.set({f"limits.{name}": value})
        loop.go_on(loop.every)

    return cause


def limit_rate(loop: Any) -> None:
    loop.set({"limits.effort_rate": (1e-4 * loop.arm.limits).tolist()})
    loop.go_on(1000)


def measure_far_off(loop: Any) -> None:
    loop.measure(6, 1.0)


def fall_silent(ms: int) -> Callable[[Any], None]:
    def cause(loop: Any) -> None:
        loop.silent = True
        loop.go_on(ms)
        loop.silent = False
        loop.go_on(loop.every)

    return cause


CAUSES = {
    Fault.STATE_STALE: fall_silent(100),
    Fault.POSITION_LIMIT: limit("max_position", 1e-3),
    Fault.VELOCITY_LIMIT: limit("velocity", 1e-3),
    Fault.TRACKING_LIMIT: limit("tracking_error", 1e-9),
    Fault.EFFORT_RATE_LIMIT: limit_rate,
    Fault.MEASUREMENT: measure_far_off,
}
ARM_AND_LAW = [(arm, law) for arm in ARMS for law in LAWS.names if law != "pidnftsm" or arm.joints <= 2]
"""Without the singular law where it swings the torque of light joints between its limits."""
HEAVIER = pytest.mark.parametrize("heavier", [-0.23, 0.43], ids=["model 30 % too heavy", "model 30 % too light"])


@HEAVIER
@pytest.mark.parametrize("cause", CAUSES, ids=lambda fault: fault.name.lower())
def test_a_stopped_arm_stays_where_it_stopped_whatever_the_cause_and_the_model(
    loop_of: Any, cause: Fault, heavier: float
) -> None:
    loop = loop_of(DRAWN_IN, heavier=heavier)
    CAUSES[cause](loop)
    assert loop.controller.status[:2] == (Mode.STOPPED, cause)
    stopped = loop.robot.state.arm.position.copy()
    assert loop.drift() < STILL
    # The arm was moving and needed some distance to stop.
    assert np.abs(loop.positions[-1] - stopped).max() < (0.15 if cause == Fault.EFFORT_RATE_LIMIT else 0.06)


@HEAVIER
@pytest.mark.parametrize(("arm", "law"), ARM_AND_LAW, indirect=["arm"], ids=str)
@pytest.mark.parametrize("rate", [100, 1000])
def test_every_law_leaves_the_arm_where_it_is(arm: Arm, law: str, rate: int, heavier: float) -> None:
    begun = 0.01 if rate == 100 else 0.001 * DRAWN_IN
    settings = arm.motion(near=True)
    settings["controller"] |= {
        "law.name": law,
        **arm.gains(law),
        "activation.blend": 0.8,
        "watchdog.state_stop": 0.02,
    }
    settings["simulator"] |= {
        "rate": rate,
        "model_error.mass": heavier,
        "model_error.inertia": heavier,
        "dropout.time": begun,
        "dropout.duration": 0.03,
    }
    run = rollout(**settings, duration=begun + 3.0)
    assert run.status[-1, Status.FAULT] == Fault.STATE_STALE
    rested = run.position[-rate:]
    assert np.abs(rested - rested[0]).max() < STILL


@HEAVIER
@pytest.mark.parametrize("moved", [0.1, 0.2, 0.3])
def test_an_arm_that_moves_fast_comes_to_rest_near_where_it_was_stopped(arm: Arm, moved: float, heavier: float) -> None:
    """After a jump of its reference, with torques far from those that carry it."""
    settings = arm.motion(near=True)
    settings["controller"] |= {"law.name": "computed_torque", "watchdog.state_stop": 0.02}
    settings["simulator"] |= {
        "model_error.mass": heavier,
        "model_error.inertia": heavier,
        "dropout.time": 1.0 + moved,
        "dropout.duration": 0.03,
    }
    settings["trajectory"] |= {"jump.position": arm.alternating(0.5).tolist(), "jump.time": 1.0}
    run = rollout(**settings, duration=5.0)
    stopped = round(1000 * (1.03 + moved))
    assert run.status[stopped, Status.FAULT] == Fault.STATE_STALE
    assert np.abs(run.velocity[stopped]).max() > 0.1
    assert np.abs(run.position[-1000:] - run.position[-1]).max() < STILL
    assert np.abs(run.position[stopped:] - run.position[stopped]).max() < 0.5


@HEAVIER
@pytest.mark.parametrize(("rate", "silence"), SILENCES)
@pytest.mark.parametrize("stopped", [False, True], ids=["following", "stopped"])
def test_the_torque_makes_no_step_while_joint_states_are_missing_or_when_they_return(
    loop_of: Any, rate: int, silence: int, stopped: bool, heavier: float
) -> None:
    loop = loop_of(2000, heavier=heavier, rate=rate, law="computed_torque", law__kp=400.0)
    if stopped:
        limit("max_position", 1e-3)(loop)
        loop.go_on(500)
    before = len(loop.efforts)
    fall_silent(silence)(loop)
    loop.go_on(500)
    assert loop.controller.fault
    assert loop.largest_step(since=before - 1) < STEP


@pytest.mark.parametrize("gravity", ["commanded", "added_by_robot"])
def test_the_holding_torque_fades_while_no_joint_state_arrives(loop_of: Any, gravity: str) -> None:
    loop = loop_of(1000, stop__fade=2.0, output__gravity=gravity)
    loop.silent = True
    loop.go_on(500)
    assert (np.abs(loop.efforts[-1]) > 0.05 * loop.arm.limits).any()
    loop.go_on(2000)
    np.testing.assert_allclose(loop.controller.effort, 0.0, atol=1e-6)
    assert (np.abs(loop.efforts[-1]).max() > 0.1) == (gravity == "added_by_robot")  # The firmware carries the arm.


@pytest.mark.parametrize("stop", ["zero", "damping", "gravity", "gravity_damping"])
def test_a_stop_leaves_gravity_to_the_firmware_that_adds_it(loop_of: Any, stop: str) -> None:
    loop = loop_of(100, stop__effort=stop, output__gravity="added_by_robot")
    loop.controller.stop(Fault.STATE_STALE, 100 * MS)
    damping = loop.controller.config.stop.damping * loop.controller.signals[Signal.VELOCITY]
    np.testing.assert_allclose(loop.controller.effort, -damping if "damping" in stop else 0.0, atol=1e-9)


@pytest.mark.parametrize("stop", ["hold", "gravity_damping"])
@pytest.mark.parametrize("silent", [False, True])
def test_brakes_are_engaged_when_the_arm_has_come_to_rest_and_released_by_the_reset(
    loop_of: Any, stop: str, silent: bool
) -> None:
    loop = loop_of(2000, stop__brakes=True, stop__effort=stop)
    engaged = [loop.controller.state.conditions[Condition.BRAKES]]
    if silent:
        loop.silent = True
        loop.go_on(30)
    else:
        limit("max_position", 1e-3)(loop)
        engaged.append(loop.controller.state.conditions[Condition.BRAKES])
        loop.go_on(2000)
    assert not any(engaged)
    assert loop.controller.state.conditions[Condition.BRAKES]
    loop.controller.reset_fault()
    assert not loop.controller.state.conditions[Condition.BRAKES]


def test_an_arm_without_brakes_engages_none(loop_of: Any) -> None:
    loop = loop_of(1000)
    fall_silent(200)(loop)
    loop.go_on(3000)
    assert not loop.controller.state.conditions[Condition.BRAKES]


@pytest.mark.parametrize("law", ["piddtsm", "super_twisting", "pid"])
def test_the_last_torque_carries_the_arm(loop_of: Any, law: str) -> None:
    loop = loop_of(DRAWN_IN, heavier=0.43, law=law)
    before = loop.controller.effort.copy()
    loop.controller.leave()
    # The motion itself needs the difference; the disturbances of the simulated arm are up to 3 N m.
    assert (np.abs(loop.controller.effort - before) < 0.12 * loop.arm.limits).all()
