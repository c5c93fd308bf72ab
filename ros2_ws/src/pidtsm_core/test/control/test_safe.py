"""A controller that has stopped holds the arm, even if its model is wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Clock
from pidtsm_core.laws import LAWS
from pidtsm_core.signals import Fault, Mode

MS = 1_000_000
STEP = 10.0
"""Largest permitted change of a torque between two commands, N m."""
RATES = [100, 250, 500, 1000]
DRAWN_IN = 6000
"""ms after which the integrals compensate the error of the model."""


def limit(name: str, value: float) -> Callable[[Any], None]:
    def cause(loop: Any) -> None:
        loop.set({f"limits.{name}": value})
        loop.go_on(1000 if name == "effort_rate" else loop.every)

    return cause


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
    Fault.EFFORT_RATE_LIMIT: limit("effort_rate", 1.0),
    Fault.MEASUREMENT: measure_far_off,
}
HEAVIER = pytest.mark.parametrize("heavier", [-0.23, 0.43], ids=["model 30 % too heavy", "model 30 % too light"])


@HEAVIER
@pytest.mark.parametrize("cause", CAUSES, ids=lambda fault: fault.name.lower())
def test_a_stopped_arm_stays_where_it_stopped_whatever_the_cause_and_the_model(
    loop_of: Any, cause: Fault, heavier: float
) -> None:
    loop = loop_of(heavier)
    loop.go_on(DRAWN_IN)
    CAUSES[cause](loop)
    assert loop.controller.status[:2] == (Mode.STOPPED, cause)
    stopped = loop.robot.state.arm.position.copy()
    assert loop.drift() < 0.002
    # The arm was moving and needed some distance to stop.
    assert np.abs(loop.positions[-1] - stopped).max() < (0.15 if cause == Fault.EFFORT_RATE_LIMIT else 0.06)


@HEAVIER
@pytest.mark.parametrize("law", LAWS.names)
@pytest.mark.parametrize("rate", [100, 1000])
def test_every_law_leaves_the_arm_where_it_is(loop_of: Any, law: str, rate: int, heavier: float) -> None:
    loop = loop_of(heavier, rate, law)
    loop.go_on(DRAWN_IN if rate == 1000 else 0)
    loop.go_on(loop.every)
    loop.controller.stop(Fault.STATE_STALE, 30 * MS)
    assert loop.drift() < 0.002


@HEAVIER
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("silence", [100, 300, 2000])
@pytest.mark.parametrize("stopped", [False, True], ids=["following", "stopped"])
def test_the_torque_makes_no_step_while_joint_states_are_missing_or_when_they_return(
    loop_of: Any, rate: int, silence: int, stopped: bool, heavier: float
) -> None:
    loop = loop_of(heavier, rate, "computed_torque", law__kp=400.0)
    loop.go_on(2000)
    if stopped:
        limit("max_position", 1e-3)(loop)
        loop.go_on(500)
    before = len(loop.efforts)
    fall_silent(silence)(loop)
    loop.go_on(1000)
    assert loop.controller.fault
    assert loop.largest_step(since=before - 1) < STEP


def test_the_holding_torque_fades_while_no_joint_state_arrives(loop_of: Any) -> None:
    loop = loop_of(stop__fade=2.0)
    loop.go_on(1000)
    loop.silent = True
    loop.go_on(500)
    held = np.abs(loop.efforts[-1]).max()
    assert held > 5.0
    loop.go_on(2000)
    np.testing.assert_allclose(loop.efforts[-1], 0.0, atol=1e-6)


@pytest.mark.parametrize("stop", ["hold", "gravity_damping"])
@pytest.mark.parametrize("silent", [False, True])
def test_brakes_are_engaged_when_the_arm_has_come_to_rest_and_released_by_the_reset(
    loop_of: Any, stop: str, silent: bool
) -> None:
    loop = loop_of(stop__brakes=True, stop__effort=stop)
    loop.go_on(2000)
    engaged = [loop.controller.clock(Clock.BRAKES)]
    if silent:
        loop.silent = True
        loop.go_on(30)
    else:
        limit("max_position", 1e-3)(loop)
        engaged.append(loop.controller.clock(Clock.BRAKES))
        loop.go_on(2000)
    assert not any(engaged)
    assert loop.controller.clock(Clock.BRAKES)
    loop.controller.reset_fault()
    assert not loop.controller.clock(Clock.BRAKES)


def test_an_arm_without_brakes_engages_none(loop_of: Any) -> None:
    loop = loop_of()
    loop.go_on(1000)
    fall_silent(200)(loop)
    loop.go_on(3000)
    assert not loop.controller.clock(Clock.BRAKES)


@pytest.mark.parametrize("law", ["piddtsm", "super_twisting", "pid"])
def test_the_last_torque_carries_the_arm(loop_of: Any, law: str) -> None:
    loop = loop_of(0.43, law=law)
    loop.go_on(DRAWN_IN)
    before = loop.controller.effort.copy()
    loop.controller.leave()
    # The motion itself needs the difference; the disturbances of the simulated arm are up to 3 N m.
    assert np.abs(loop.controller.effort - before).max() < 12.0
