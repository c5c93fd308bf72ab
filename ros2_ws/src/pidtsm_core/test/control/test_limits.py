"""Limits of position and velocity: those of the description are the defaults."""

import numpy as np
import pytest

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Signal, Status, Violation

PANDA = {"robot.description": "panda"}
MS = 1_000_000


def test_those_of_the_description_are_the_defaults() -> None:
    values, robot = resolve(controller_schema, PANDA, 7), find_robot(PANDA)
    limits = np.array([values["limits.min_position"], values["limits.max_position"]]).T
    np.testing.assert_array_equal(limits, robot.position_limits)
    assert limits[3].tolist() == [-3.0718, -0.0698]  # The elbow bends in one direction.
    assert values["limits.velocity"] == robot.velocity_limit
    without = resolve(controller_schema, {}, 2)
    assert without["limits.min_position"] == without["limits.max_position"] == without["limits.velocity"] == 0.0


@pytest.mark.parametrize("action", ["stop", "warn"])
@pytest.mark.parametrize(("joint", "beyond"), [(0, 2.92), (0, -2.92), (3, 0.0), (3, -3.1), (5, -0.1)])
def test_a_joint_beyond_either_end_is_noticed(joint: int, beyond: float, action: str) -> None:
    controller = Controller(resolve(controller_schema, {**PANDA, "limits.position_action": action}, 7))
    controller.position[:] = controller.reference[0] = find_robot(PANDA).initial_position
    controller.step(MS, MS)
    assert not any(controller.status[Status.FAULT :])
    controller.position[joint] = beyond
    controller.reset()
    controller.step(2 * MS, 2 * MS)
    assert controller.status[Status.VIOLATIONS] & Violation.POSITION
    stopped = (Fault.POSITION_LIMIT, joint + 1) if action == "stop" else (0, 0)
    assert controller.status[Status.FAULT : Status.FAULT_JOINT + 1] == stopped


@pytest.mark.parametrize("end", ["upper", "lower"])
@pytest.mark.parametrize("robot", ["panda", "scara"])
def test_a_motion_may_end_at_a_limit_whatever_the_encoder_measures_there(robot: str, end: str) -> None:
    arm = find_robot({"robot.description": robot})
    ranges = np.array(arm.position_limits)
    finite = np.isfinite(ranges).all(axis=1)
    start = np.where(finite, ranges[:, 1 if end == "upper" else 0], arm.initial_position)
    settings = {
        "simulator": {
            "robot.description": robot,
            "initial_position": start.tolist(),
            "encoder.bits": 12,
            "noise.std": 1e-4,
        },
        "controller": {"robot.description": robot},
        "trajectory": {
            "reference.name": "minimum_jerk",
            "reference.from": start.tolist(),
            "reference.to": start.tolist(),
        },
    }
    run = rollout(Experiment("limit", "", 3.0, settings), params="practical")
    measured = run.signals[:, Signal.POSITION]
    assert (np.abs(measured - start)[:, finite] > 0.0).any()
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(run.signals[-1000:, Signal.POSITION_ERROR]).max() < 2e-2


@pytest.mark.parametrize("rate", [0.0, 1000.0])
def test_the_way_to_the_reference_keeps_within_the_velocity_limits(rate: float) -> None:
    start = np.array(find_robot(PANDA).initial_position)
    run = rollout(
        robot="panda",
        duration=4.0,
        controller={"activation.blend": 0.8, "limits.effort_rate": rate, "activation.distance": 1.0},
        simulator={"initial_position": (start + np.resize([0.6, -0.3], 7)).tolist()},
    )
    assert not run.status[-1, Status.FAULT]
    assert np.abs(run.signals[-1, Signal.POSITION_ERROR]).max() < 2e-3


@pytest.mark.parametrize(
    "limits",
    [
        {"limits.min_position": 0.5, "limits.max_position": 0.4},
        {"limits.min_position": [-1.0, 1.0], "limits.max_position": [1.0, 0.0]},
        {"limits.min_position": 0.1},
    ],
)
def test_ends_in_the_wrong_order_are_refused(limits: dict[str, object]) -> None:
    with pytest.raises(ParameterError, match=r"limits\.min_position: .* exceeds limits\.max_position"):
        resolve(controller_schema, limits, 2)
