"""No reference and no hand gets a joint past its limit where there is a barrier, and the arm does not stop there."""

from typing import Any

import numpy as np
import pytest
from support.testarms import dotted

import pidtsm_core as pidtsm
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.signals import Fault, Mode, Request, Status
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

STEP = 1_000_000
MARGIN = 0.05


def run(
    arm: str,
    reference: Any,
    push: Any,
    seconds: float,
    hardware: dict[str, Any] | None = None,
    margin: float = MARGIN,
    **chosen: float,
) -> tuple[Array, list[tuple[int, int]]]:
    """Measured positions, shape (samples, joints), and modes and faults.

    `reference` writes to the desired motion at a time; `push` returns the efforts of a hand at a time and position;
    `chosen` are parameters of the controller, with two underscores instead of the dot.
    """
    robot = find_robot({"robot.description": arm})
    limits = np.array(robot.position_limits)
    inner = np.minimum(0.3, 0.3 * (limits[:, 1] - limits[:, 0]))
    start = np.clip(np.array(robot.initial_position), limits[:, 0] + inner, limits[:, 1] - inner)
    settings = {
        "robot.description": arm,
        "initial_position": start.tolist(),
        "disturbance.name": "none",
        **(hardware or {}),
    }
    simulated = SimulatedRobot(resolve(simulator_schema, settings, len(start)))
    settings = {"barrier.margin": margin, **dotted(chosen)}
    controller = pidtsm.make_controller(robot=arm, params="practical", controller=settings)
    path, states = np.zeros((round(seconds * 1e3), len(start))), []
    for k in range(len(path)):
        controller.reference[:] = 0.0
        controller.reference[0] = start
        reference(1e-3 * k, controller.reference, start)
        _, measured = simulated.sense(k)
        controller.position[:] = measured
        controller.step(k * STEP, k * STEP)
        if k == 50 and push is not None:
            assert not controller.request(Request.FREE)
        simulated.act(k, True, controller.effort + (push(1e-3 * k, measured) if push is not None else 0.0))
        path[k] = measured
        states.append((controller.status[Status.MODE], controller.status[Status.FAULT]))
    return path, states


def room(arm: str, path: Array) -> float:
    """Least distance of a joint from its limits, rad or m."""
    lower, upper = np.array(find_robot({"robot.description": arm}).position_limits).T
    return float(min((path - lower).min(), (upper - path).min()))


def beyond(t: float, desired: Array, start: Array, joint: int, end: float, speed: float) -> None:
    """A motion of a joint to `end`, rad or m."""
    way = end - start[joint]
    share = min(speed * t / way, 1.0)
    desired[0, joint] += way * share * share * (3.0 - 2.0 * share)
    desired[1, joint] = 6.0 * speed * share * (1.0 - share)


@pytest.mark.parametrize(("arm", "joint"), [("panda", 1), ("ur5", 2), ("z1", 3), ("scara", 2)])
@pytest.mark.parametrize("by", ["a reference", "a hand"])
def test_nothing_gets_a_joint_past_its_limit_and_the_arm_does_not_stop(arm: str, joint: int, by: str) -> None:
    """A reference goes 0.1 rad (or m) beyond the limit; a hand pushes with 30 % of the effort limit, in freedrive.

    Masses are 20 % wrong, joints have friction, encoders 14 bits.
    """
    robot = find_robot({"robot.description": arm})
    upper, slides = np.array(robot.position_limits)[joint, 1], bool(robot.slides) and robot.slides[joint]
    speed = 0.1 if slides else 0.8

    def reference(t: float, desired: Array, start: Array) -> None:
        if by == "a reference":
            beyond(t, desired, start, joint, upper + 0.1, speed)

    def hand(t: float, _position: Array) -> Array:
        return 0.3 * robot.effort_limit[joint] * np.eye(len(robot.joints))[joint] * (t > 0.1)

    push = hand if by == "a hand" else None
    simulated = {"encoder.bits": 14, "model_error.mass": 0.2, "friction.coulomb": 0.5}
    path, states = run(arm, reference, push, 5.0, hardware=simulated)
    assert not any(fault for _, fault in states)
    assert states[-1][0] == (Mode.FREEDRIVE if push else Mode.FOLLOWING)
    assert room(arm, path) > 0.0
    if push is None:  # In freedrive the anchors keep away farther.
        assert upper - path[-1, joint] < MARGIN + 0.02


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_joint_that_brakes_as_much_as_it_can_is_not_pushed_on_by_the_others(direction: float) -> None:
    """A fast hand, and a load that the model lacks: the effort limit is reached."""

    def hand(t: float, _position: Array) -> Array:
        return direction * 0.3 * 87.0 * np.eye(7)[1] * (t > 0.1)

    simulated = {"encoder.bits": 14, "model_error.mass": 0.2, "friction.coulomb": 0.5}
    path, states = run(
        "panda", lambda *_: None, hand, 4.0, hardware=simulated, freedrive__velocity=2.0, barrier__approach=6.0
    )
    assert not any(fault for _, fault in states)
    assert room("panda", path) > 0.0


def test_without_a_barrier_the_arm_stops_behind_its_limit() -> None:
    def reference(t: float, desired: Array, start: Array) -> None:
        beyond(t, desired, start, 1, 1.8628, 0.8)

    path, states = run("panda", reference, None, 3.5, margin=0.0)
    assert room("panda", path) < 0.0
    assert states[-1][1] == Fault.POSITION_LIMIT
