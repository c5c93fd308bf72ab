"""A stop is never worse than what it stops, whatever its measurements, limits and loads are."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import Count, controller_schema
from pidtsm_core.laws import LAWS
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Signal, Status, Stop

RUNNING = 1500  # ms before something happens
LONG = 3000  # ms afterwards
NEAR = 0.06
"""Largest motion of an arm that is stopped from at most 0.3 rad/s, rad."""


def moved(loop: Any, ms: int = LONG) -> float:
    """Largest motion of the arm in the next ms, rad or m."""
    begun = len(loop.positions)
    loop.go_on(ms)
    return float(np.abs(np.array(loop.positions[begun - 1 :]) - loop.positions[begun - 1]).max())


@pytest.mark.parametrize("off", [0.002, 0.005, 0.01, 0.02, 0.05, 0.5], ids=lambda off: f"{off} rad")
@pytest.mark.parametrize("samples", [1, 3])
def test_a_wrong_measurement_that_stops_the_arm_does_not_throw_it(loop_of: Any, off: float, samples: int) -> None:
    loop = loop_of(RUNNING, law="computed_torque")
    loop.set({"limits.velocity": 0.4})
    loop.measure(samples, off)
    assert moved(loop) < NEAR or not loop.controller.fault


@pytest.mark.parametrize("law", ["computed_torque", "piddtsm"])
@pytest.mark.parametrize(
    "falsify",
    [lambda q: -q, lambda q: q + 0.3, lambda q: 2.0 - q],
    ids=["sign flipped", "slipped", "sign flipped and slipped"],
)
def test_an_encoder_that_lies_stops_the_arm_where_it_is(
    loop_of: Any, law: str, falsify: Callable[[Array], Array]
) -> None:
    loop = loop_of(RUNNING, law=law)
    loop.falsify = falsify
    assert moved(loop) < NEAR
    assert loop.controller.fault == Fault.MEASUREMENT


@pytest.mark.parametrize("law", ["computed_torque", "piddtsm"])
def test_a_source_that_repeats_its_last_positions_is_noticed(loop_of: Any, law: str) -> None:
    """The arm is held meanwhile, as by its brakes."""
    loop = loop_of(RUNNING, law=law)
    loop.freeze()
    before = loop.controller.effort.copy()
    loop.go_on(2000)
    assert loop.controller.fault == Fault.NO_EFFECT
    demanded = np.abs(np.array(loop.efforts[-2000:]) - before) / loop.arm.limits
    stopped = int(np.flatnonzero(demanded.max(axis=1) == demanded.max())[0])
    # Then the torque returns to that before, and fades.
    assert demanded[-1].max() < 0.35 * demanded[stopped].max() + 0.3


@pytest.mark.parametrize("law", ["computed_torque", "piddtsm"])
@pytest.mark.parametrize("locked", [2000, 3500])
def test_an_arm_that_was_locked_is_held_when_it_can_move_again(loop_of: Any, law: str, locked: int) -> None:
    """As one whose torques another controller had kept from it, or whose motors had no power."""
    loop = loop_of(RUNNING, law=law)
    loop.freeze()
    loop.go_on(locked)
    assert loop.controller.fault == Fault.NO_EFFECT
    loop.freeze(False)
    before = len(loop.positions)
    loop.go_on(2000)
    way = np.abs(np.array(loop.positions[before:]) - loop.positions[before - 1]).max()
    assert way < NEAR, "rad or m"
    assert loop.drift() < 0.01


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_an_arm_at_rest_or_with_slow_joints_is_no_source_that_repeats_its_positions(loop_of: Any, bits: int) -> None:
    loop = loop_of(law="piddtsm")
    step = 2.0 * np.pi / 2**bits
    loop.falsify = lambda q: np.round(q / step) * step
    loop.go_on(4000)
    assert loop.controller.fault == Fault.NO_FAULT


def noisy_rest() -> Recording:
    """An arm that is almost at rest, with a coarse encoder that the estimate of the velocity exaggerates."""
    simulator = {"rate": 2000, "encoder.bits": 10}
    return rollout(robot="z1", law="computed_torque", duration=3.0, simulator=simulator)


def test_an_arm_almost_at_rest_stays_where_it_is_when_its_noise_stops_it() -> None:
    run = noisy_rest()
    (stopped, *_) = np.flatnonzero(run.status[:, Status.FAULT])
    assert run.status[-1, Status.FAULT] == Fault.VELOCITY_LIMIT
    assert np.abs(run.position[stopped:] - run.position[stopped]).max() < 0.005


@pytest.mark.parametrize("robot", ["panda", "scara", "ur5"])
@pytest.mark.parametrize("share", [1.0, 5.0], ids=lambda share: f"{share} times the effort limit per second")
def test_a_stop_under_a_rate_limit_ends_at_rest(robot: str, share: float) -> None:
    """A collision causes it, and another push meets the stopped arm."""
    limits = np.array(find_robot({"robot.description": robot}).effort_limit)
    run = rollout(
        robot=robot,
        params="practical",
        duration=6.0,
        controller={"limits.effort_rate": (share * limits).tolist(), "limits.tracking_error": 0.05},
        trajectory={"jump.position": 0.3, "jump.time": 1.0},
        simulator={"push.effort": (0.3 * limits).tolist(), "push.time": 2.0, "push.duration": 0.1},
    )
    assert run.status[-1, Status.FAULT] != 0
    assert np.abs(run.velocity[-500:]).max() < 0.05
    assert np.abs(run.velocity).max() < 15.0


@pytest.mark.parametrize(("robot", "mass"), [("z1", 2.0), ("two_link", 2.0), ("ur5", 2.0), ("ur5", 0.0)])
def test_a_reset_makes_no_step_and_keeps_what_carries_an_unknown_load(robot: str, mass: float) -> None:
    limits = np.array(find_robot({"robot.description": robot}).effort_limit)
    run = rollout(
        robot=robot,
        params="practical",
        duration=7.0,
        controller={"rehearsal.reset_fault": 5.0, "watchdog.state_stop": 0.02},
        simulator={"payload.mass": mass, "payload.time": 1.0, "dropout.time": 3.0, "dropout.duration": 0.05},
    )
    reset = int(np.flatnonzero(run.status[:, Status.FAULT])[-1])
    assert run.status[-1, Status.FAULT] == 0
    steps = np.abs(np.diff(run.signals[reset - 1 : reset + 300, Signal.EFFORT], axis=0)) / limits
    assert steps.max() < 0.02
    # It leaves the place where it was held only to follow its reference.
    way = np.abs(run.reference[reset, 0] - run.position[reset])
    assert (np.abs(run.position[reset : reset + 50] - run.position[reset]) < 0.002 + 0.1 * way).all()


@pytest.mark.parametrize("law", [law for law in LAWS.names if law != "pidnftsm"])
@pytest.mark.parametrize("factor", [3.0, 1.0 / 3.0], ids=["three times", "a third"])
def test_a_gain_that_is_changed_in_motion_makes_no_step(loop_of: Any, law: str, factor: float) -> None:
    """Without the singular law, which makes steps by itself."""
    first = loop_of(RUNNING, law=law)
    values = {name: value for name, value in first.values().items() if name.startswith("law.")}
    numbers = {name: value for name, value in values.items() if isinstance(value, (float, tuple))}
    numbers.pop("law.alpha", None)  # It is an exponent, and with a small one the law makes steps by itself.
    if not LAWS[law].uses_model:
        numbers.pop("law.inertia", None)  # With more than the arm's, the loop is unstable.
    ranges = {p.name: (p.minimum or 0.0, p.maximum) for p in controller_schema(first.values())}
    assert numbers
    for name, value in numbers.items():
        loop = loop_of(RUNNING, law=law)
        loop.set({name: np.clip(np.asarray(value, dtype=float) * factor, *ranges[name]).tolist()})
        loop.go_on(2)
        assert loop.largest_step(since=-3) < 0.02, name


def test_the_stage_of_a_stop_is_named(loop_of: Any) -> None:
    loop = loop_of(RUNNING)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.NONE
    loop.set({"limits.velocity": 1e-3})
    loop.go_on(10)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.HOLD
    loop.silent = True
    loop.go_on(100)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.BLIND
    loop.silent = False
    loop.go_on(10)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.HOLD
    loop.set({})
    loop.controller.reset_fault()
    loop.go_on(10)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.NONE


def test_an_arm_that_is_thrown_from_its_place_is_damped_then_held_again(loop_of: Any) -> None:
    loop = loop_of(RUNNING)
    loop.set({"limits.velocity": 1e-3})
    loop.go_on(500)
    loop.robot.state.arm.derivatives[0, :] += 4.0
    stages = []
    for _ in range(1500):
        loop.go_on(1)
        stages.append(loop.controller.status[Status.STOP_STAGE])
    assert Stop.DAMPING in stages
    assert stages[-1] == Stop.HOLD
    assert loop.controller.state.counts[Count.RESTED] > 0
    assert np.abs(loop.robot.state.arm.derivatives[0]).max() < 0.05


def test_a_controller_that_restarts_keeps_nothing_of_a_stop(loop_of: Any) -> None:
    loop = loop_of(RUNNING)
    loop.set({"limits.velocity": 1e-3})
    loop.go_on(500)
    assert loop.controller.status[Status.STOP_STAGE] == Stop.HOLD
    loop.set({"rehearsal.restart": 1e-3})
    loop.go_on(2)  # The time counts from the next joint state on.
    fresh = loop_of()
    np.testing.assert_array_equal(loop.controller.state.law, fresh.controller.state.law)
    assert not loop.controller.fault
