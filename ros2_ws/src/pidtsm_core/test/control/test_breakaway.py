"""Joints that leave rest begin with what they were in motion, if friction explains the difference."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control.breakaway import break_away, is_at_rest
from pidtsm_core.control.controller import Controller
from pidtsm_core.control.modes import begin_afresh
from pidtsm_core.control.rests import BACK, FORTH
from pidtsm_core.control.state import Time
from pidtsm_core.estimators import DISTURBANCE
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.default_motion import default_motion
from pidtsm_core.parameters import as_float
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Signal, Status

SWITCH = "compensation.breakaway"
VALUES = make_experiment(None, robot="ur5", hardware="geared").values["controller"]
DT = 2e-3


def unpressed(robot: str, hardware: str) -> dict[str, Any]:
    """The Coulomb friction of half-warm gears is compensated, and the error adds nothing."""
    usual = make_experiment(None, None, 1.0, (), {}, robot, hardware).values
    friction = np.asarray(usual["simulator"]["friction.coulomb"], np.float64)
    warm = 1.0 + 0.5 * as_float(usual["simulator"]["friction.cold"])
    return {"compensation.coulomb": (warm * friction).tolist(), "compensation.error_gain": 0.0}


def run(
    robot: str,
    hardware: str,
    law: str,
    breakaway: bool,
    simulator: dict[str, Any],
    scale: float,
    controller: dict[str, Any] | None = None,
) -> Recording:
    """Move between two places, resting at each; where the error adds nothing, unless `controller` says otherwise."""
    usual = default_motion(find_robot({"robot.description": robot}))["trajectory"]
    middle, amplitude = (np.array(usual[f"reference.{name}"]) for name in ("offset", "amplitude"))
    ends = [(middle + sign * scale * amplitude).tolist() for sign in (-1.0, 1.0)]
    given = unpressed(robot, hardware) if controller is None else controller
    overrides = {"simulator": {"initial_position": ends[0], **simulator}, "controller": {SWITCH: breakaway, **given}}
    experiment = make_experiment(None, law, 8.0, (), overrides, robot, hardware)
    trajectory = {
        "joints": experiment.values["trajectory"]["joints"],
        "reference.name": "pick_and_place",
        "reference.from": ends[0],
        "reference.to": ends[1],
        "reference.duration": 1.0,
        "reference.rest": 0.5,
    }
    return rollout(replace(experiment, settings={**experiment.settings, "trajectory": trajectory}))


def largest(run_: Recording) -> float:
    """Largest error once each direction was gone before, rad."""
    return float(np.abs(run_.error[run_.time > 3.0]).max())


@pytest.mark.parametrize(
    ("robot", "hardware", "law"),
    [
        ("ur5", "geared", "piddtsm"),
        ("z1", "geared", "piddtsm"),
        ("scara", "geared", "computed_torque"),
        ("ur5", "geared", "pidnftsm"),
        ("panda", "collaborative", "dtsm"),
        ("panda", "hobby", "piddtsm"),
    ],
)
def test_an_arm_leaves_rest_with_less_error(robot: str, hardware: str, law: str) -> None:
    before, now = (largest(run(robot, hardware, law, each, {}, 0.5)) for each in (False, True))
    assert now < 0.6 * before


@pytest.mark.parametrize("robot", ["ur5", "z1", "scara"])
def test_it_helps_joints_that_are_pressed_by_their_error_too(robot: str) -> None:
    before, now = (largest(run(robot, "geared", "piddtsm", each, {}, 0.5, {})) for each in (False, True))
    assert now < 0.85 * before


@pytest.mark.parametrize(
    "simulator",
    [
        {"payload.mass": 2.0, "payload.time": 4.25},  # While it rests.
        {"payload.mass": 2.0, "payload.time": 4.75},  # While it moves.
        {"push.effort": [0.0, 40.0, 0.0, 0.0, 0.0, 0.0], "push.time": 4.25, "push.duration": 0.1},
    ],
)
@pytest.mark.parametrize("hardware", ["geared", "collaborative"])
def test_another_load_or_a_push_costs_at_most_twice_the_error(hardware: str, simulator: dict[str, Any]) -> None:
    before, now = (largest(run("ur5", hardware, "piddtsm", each, simulator, 0.3)) for each in (False, True))
    assert now < 2.1 * before  # Once, where the reference sets off while the arm still sags.


def test_without_compensated_friction_every_bit_is_as_before() -> None:
    off, on = (rollout(params="practical", robot="ur5", duration=1.0, controller={SWITCH: s}) for s in (False, True))
    np.testing.assert_array_equal(on.effort, off.effort)


@pytest.fixture
def controller() -> Controller:
    made = Controller(VALUES)
    made.state.measured[:] = [0.1, -1.2, 1.0, 0.3, 0.4, 0.2]
    made.state.signals[Signal.POSITION] = made.state.measured
    return made


def go(controller: Controller, velocity: Array | float, seconds: float, found: Array | float = 0.0) -> None:
    """Let the reference have a velocity (rad/s), which the arm follows, while the observer finds a disturbance."""
    state = controller.state
    state.desired[1] = state.signals[Signal.VELOCITY] = velocity
    for _ in range(round(seconds / DT)):
        state.estimator[: controller.joints, DISTURBANCE] = found
        break_away(controller.config, state, DT)


def set_off(controller: Controller, velocity: float) -> Array:
    """Let the reference set off within 50 ms; returns how much the disturbance has changed."""
    state = controller.state
    assert is_at_rest(state, 0) == (state.status[Status.FAULT] == 0 and state.times[Time.FREED] == 0)
    before = state.estimator[: controller.joints, DISTURBANCE].copy()
    for share in np.linspace(0.02, 1.0, 25):
        state.desired[1] = share * velocity
        state.signals[Signal.VELOCITY] = 0.0
        break_away(controller.config, state, DT)
    found: Array = state.estimator[: controller.joints, DISTURBANCE] - before
    return found


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_it_begins_with_what_was_found_in_motion_that_way(controller: Controller, way: float) -> None:
    go(controller, 0.2, 0.5, found=1.0)
    go(controller, -0.2, 0.5, found=-2.0)
    stuck = np.array([0.5, -1.0, 1.0, 0.5, 0.5, 0.5])
    go(controller, 0.0, 0.2, found=stuck)
    wanted = (1.0 if way > 0.0 else -2.0) - stuck
    np.testing.assert_allclose(set_off(controller, way * 0.02), math.tanh(2.0) * wanted, rtol=1e-6)


@pytest.mark.parametrize(("share", "changes"), [(1.95, True), (2.05, False)])
def test_what_static_friction_does_not_explain_is_left_alone(
    controller: Controller, share: float, changes: bool
) -> None:
    go(controller, 0.2, 0.5, found=0.0)
    inertia = find_robot(VALUES).inertia_matrix(controller.config.model.parameters, controller.state.measured)
    elbow = np.zeros(controller.joints)
    elbow[2] = share * controller.config.compensation.coulomb[2] / inertia[2, 2]
    go(controller, 0.0, 0.2, found=elbow)
    np.testing.assert_allclose(set_off(controller, -0.02), -math.tanh(2.0) * elbow * changes, rtol=1e-6)


FORGETS: dict[str, Callable[[Controller], Any]] = {
    "it has not moved": lambda each: each.reset(),
    "a fault": lambda each: each.state.status.__setitem__(Status.FAULT, Fault.VELOCITY_LIMIT),
    "led by hand": lambda each: each.state.times.__setitem__(Time.FREED, 1),
    "other parameters": lambda each: each.set_parameters(VALUES),
    "a new beginning": lambda each: begin_afresh(each.state),
}


@pytest.mark.parametrize("why", FORGETS)
def test_nothing_changes_after(controller: Controller, why: str) -> None:
    go(controller, 0.2, 0.5, found=1.0)
    FORGETS[why](controller)
    go(controller, 0.0, 0.2, found=3.0)
    np.testing.assert_array_equal(set_off(controller, 0.05), 0.0)


@pytest.mark.parametrize("robot", ["z1", "xarm7"])
def test_reversals_without_a_rest_have_the_same_bits(robot: str) -> None:
    off, on = (rollout(params="practical", robot=robot, duration=4.0, controller={SWITCH: s}) for s in (False, True))
    np.testing.assert_array_equal(on.effort, off.effort)


def test_what_is_not_finite_is_not_learnt(controller: Controller) -> None:
    for absurd in (math.nan, math.inf):
        go(controller, 0.2, 0.2, found=absurd)
    rests = controller.state.rests
    assert (rests.moved[[FORTH, BACK]] == 0.0).all()
    assert np.isfinite(rests.disturbance).all()
