"""Joints that stick are pressed by their error: they lag less, and none rings because its friction is less."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.control.controller import Controller
from pidtsm_core.control.joint_friction import press
from pidtsm_core.experiment import make_experiment
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal, Status

GAIN = "compensation.error_gain"


def run(robot: str, hardware: str, pressed: bool, share: float = 1.0, frequency: float = 0.1) -> Recording:
    """Follow slow sines with the gains of the rule, or without what the error adds.

    Args:
        robot, hardware: as for `make_experiment`.
        pressed: whether the error adds anything.
        share: true friction, relative to that of the class.
        frequency: Hz; 0: rest.
    """
    usual = make_experiment(None, None, 1.0, (), {}, robot, hardware)
    simulator = usual.values["simulator"]
    friction = {
        name: (share * np.asarray(simulator[name])).tolist() for name in ("friction.coulomb", "friction.static")
    }
    overrides: dict[str, dict[str, Any]] = {
        "controller": {name: usual.values["controller"][name] for name in ("compensation.coulomb", GAIN)},
        "simulator": friction,
        "trajectory": {"reference.frequency": frequency},
    }
    if not pressed:
        overrides["controller"][GAIN] = 0.0
    return rollout(make_experiment(None, None, 8.0, (), overrides, robot, hardware))


def error(recording: Recording) -> float:
    """Root mean square of the joint that errs most, from 3 s on, rad."""
    return float(np.sqrt(np.mean(recording.error[recording.time > 3.0] ** 2, axis=0)).max())


def roughness(recording: Recording) -> float:
    """Mean change of the command from one sample to the next, of the roughest joint, as a share of its friction."""
    changes = np.abs(np.diff(recording.commanded_effort[recording.time > 3.0], axis=0)).mean(axis=0)
    return float((changes / np.asarray(recording.parameters["controller"]["compensation.coulomb"])).max())


@pytest.mark.parametrize("robot", ["ur5", "z1"])
def test_joints_that_stick_lag_less(robot: str) -> None:
    before, now = (error(run(robot, "geared", pressed)) for pressed in (False, True))
    assert now < 0.85 * before


@pytest.mark.parametrize(
    ("robot", "hardware"), [("ur5", "geared"), ("z1", "geared"), ("scara", "geared"), ("panda", "hobby")]
)
def test_where_less_friction_is_there_than_compensated_the_error_makes_up_for_it(robot: str, hardware: str) -> None:
    before, now = (error(run(robot, hardware, pressed, 0.5)) for pressed in (False, True))
    assert now < 0.65 * before


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize(("robot", "hardware"), [("ur5", "geared"), ("xarm7", "geared"), ("ur5", "hobby")])
def test_an_arm_at_rest_does_not_ring(robot: str, hardware: str, share: float) -> None:
    found = run(robot, hardware, True, share, 0.0)
    assert roughness(found) < 0.01
    assert error(found) < 2e-3


def test_without_compensated_friction_every_bit_is_as_before() -> None:
    off, on = (rollout(params="practical", robot="ur5", duration=1.0, controller={GAIN: g}) for g in (0.0, 8.0))
    np.testing.assert_array_equal(on.effort, off.effort)


def test_an_effort_whose_rate_is_limited_is_not_pressed() -> None:
    made = make_experiment(None, robot="ur5", hardware="geared").values["controller"]
    limited = {**made, "limits.effort_rate": [500.0, 0.0, 500.0, 0.0, 0.0, 0.0]}
    found = Controller(limited).config.compensation.error_gain
    np.testing.assert_array_equal(found > 0.0, [False, True, False, True, True, True])
    # Pressed, this arm rings until it is stopped.
    runs = []
    for gain in (0.0, 8.0):
        controller = {"limits.effort_rate": 500.0, GAIN: gain}
        runs.append(rollout(make_experiment(None, None, 2.0, (), {"controller": controller}, "ur5", "geared")))
    assert not runs[1].status[:, Status.FAULT].any()
    np.testing.assert_array_equal(runs[1].effort, runs[0].effort)


def test_an_error_that_is_not_finite_adds_nothing() -> None:
    controller = Controller(make_experiment(None, robot="ur5", hardware="geared").values["controller"])
    controller.state.signals[Signal.POSITION_ERROR] = [np.nan, np.inf, -np.inf, 0.0, 1.0, -1.0]
    added = [press(controller.config, controller.state, 0.0, j) for j in range(6)]
    coulomb = controller.config.compensation.coulomb
    np.testing.assert_allclose(added, 0.7 * coulomb * [0.0, -1.0, 1.0, 0.0, -1.0, 1.0], atol=1e-12)
    np.testing.assert_array_equal(controller.state.pressed, added)
