"""Arms whose firmware adds gravity to the command."""

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot, inverse_dynamics, make_model
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal

GRAVITY = "output.gravity"
DURATION = 1.0


def motion(robot: str, controller: str = "commanded", simulator: str = "commanded", payload: float = 0.0) -> Recording:
    """The default motion, with who adds gravity, and a payload that the controller knows."""
    wide = {"limits.effort": 1000.0, "payload.mass": payload}
    return rollout(
        robot=robot,
        duration=DURATION,
        controller={GRAVITY: controller, **wide},
        simulator={GRAVITY: simulator, **wide},
    )


def weight(robot: str, q: Array) -> Array:
    """Effort that carries the arm at q."""
    found = find_robot({"robot.description": robot})
    values = {f"robot.{p.name}": p.default for p in found.parameters}
    still, effort = np.zeros((1, q.size)), np.zeros((1, q.size))
    inverse_dynamics(make_model(found, found.pack_model(values)), q, still[0], still, effort)
    return effort[0]


@pytest.mark.parametrize("robot", ["two_link", "scara", "panda"])
def test_the_arm_moves_the_same_whoever_adds_gravity(robot: str) -> None:
    ours, theirs = motion(robot), motion(robot, "added_by_robot", "added_by_robot")
    np.testing.assert_allclose(theirs.position, ours.position, rtol=0, atol=1e-12)
    # The drives report all of the torque, and the controller counts with all of it.
    np.testing.assert_allclose(theirs.effort, ours.effort, rtol=0, atol=1e-9)
    np.testing.assert_allclose(theirs.signals, ours.signals, rtol=0, atol=1e-6)


def test_the_command_carries_a_payload_that_the_firmware_does_not_know() -> None:
    ours, theirs = motion("panda", payload=2.0), motion("panda", "added_by_robot", "added_by_robot", payload=2.0)
    np.testing.assert_allclose(theirs.position, ours.position, rtol=0, atol=1e-12)
    assert np.abs(theirs.signals[:, Signal.POSITION_ERROR]).max() < 1e-3


@pytest.mark.parametrize("robot", ["two_link", "scara", "panda"])
@pytest.mark.parametrize(
    ("controller", "simulator", "times"), [("commanded", "added_by_robot", 2.0), ("added_by_robot", "commanded", 0.0)]
)
def test_commanding_it_twice_or_never_is_the_classic_accident(
    robot: str, controller: str, simulator: str, times: float
) -> None:
    wrong = motion(robot, controller, simulator).effort[0] - motion(robot).effort[0]
    np.testing.assert_allclose(wrong, (times - 1.0) * weight(robot, motion(robot).position[0]), atol=1e-9)
