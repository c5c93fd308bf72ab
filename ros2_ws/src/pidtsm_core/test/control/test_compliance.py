"""The reference yields to what acts on the arm, and MuJoCo is the judge."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.compliance_parameters import SPACE
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.parameters import ParameterError, Value, resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.signals import Signal
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_core.trajectories.tool import tool_pose

START = [0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8]
WALL = '<mujoco><worldbody><geom type="box" size="0.5 0.05 1" pos="0.6 0.16 0.5"/></worldbody></mujoco>'
"""5 cm beside the last link."""
RESTS = {"reference.name": "sines", "reference.amplitude": 0.0, "reference.offset": START}
HEAVIER = {"model_error.mass": 0.2, "model_error.inertia": 0.2}
REAL = {"model_error.mass": 0.1, "model_error.inertia": 0.1, "encoder.bits": 17}
TOOL = {SPACE.name: "tool", "compliance.dead_zone": 0.0}


class Yielding:
    """A Panda on MuJoCo that rests, and has found out what acts on it; at 1 kHz."""

    def __init__(self, controller: dict[str, Any], simulator: dict[str, Any] | None = None) -> None:
        own = {"compensation.coulomb": 0.0, "compensation.viscous": 0.0, **controller}
        arm = {"engine": "mujoco", "initial_position": START, "friction.coulomb": 0.0, "friction.viscous": 0.0}
        given = {"controller": own, "simulator": {**arm, **(simulator or {})}, "trajectory": RESTS}
        made = make_experiment(None, None, 1.0, "practical", given, "panda", purpose=MEASUREMENT).values
        self.values, self.simulator, self.sample = made["controller"], made["simulator"], 0
        self.controller, self.robot = Controller(self.values), SimulatedRobot(self.simulator)
        self.desired = np.array([START, 7 * [0.0], 7 * [0.0]])
        self.advance(1500)

    def advance(self, samples: int) -> Array:
        """Returns the commands, shape (samples, joints), N m."""
        efforts = np.empty((samples, 7))
        for k in range(samples):
            _, self.controller.position[:] = self.robot.sense(self.sample)
            self.controller.reference[:] = self.desired
            self.controller.step(self.sample * 1_000_000, self.sample * 1_000_000)
            self.robot.act(self.sample, True, self.controller.effort)
            efforts[k] = self.controller.effort
            self.sample += 1
        return efforts

    def swing(self, angle: float, samples: int) -> None:
        """Turn the first joint of the reference."""
        self.desired[1, 0] = angle / samples * 1e3
        for _ in range(samples):
            self.desired[0, 0] += angle / samples
            self.advance(1)
        self.desired[1, 0] = 0.0

    def set(self, **values: Value) -> None:
        self.values = {**self.values, **{f"compliance.{name}": value for name, value in values.items()}}
        self.controller.set_parameters(self.values)

    @property
    def tool(self) -> Array:
        return tool_pose(find_robot(self.values), self.values, self.robot.state.arm.position)[0]

    def pushed(self, axis: int, force: float, samples: int) -> float:
        """How far a push moves the tool along the axis, m."""
        wrench, before = np.zeros(6), self.tool[axis]
        wrench[axis] = force
        self.robot.push(wrench)
        self.advance(samples)
        return float(self.tool[axis] - before)


@pytest.mark.parametrize(("axis", "stiffness", "heavier"), [(0, 300.0, False), (2, 3000.0, True)])
def test_the_tool_yields_by_the_force_over_the_stiffness(axis: int, stiffness: float, heavier: bool) -> None:
    """With the dead zone, a second push shows the stiffness."""
    soft = {SPACE.name: "tool", "compliance.stiffness": [stiffness] * 3 + [50.0] * 3}
    arm = Yielding(soft, HEAVIER if heavier else {})
    arm.pushed(axis, 30.0, 1500)
    assert 30.0 / arm.pushed(axis, 60.0, 1500) == pytest.approx(stiffness, rel=0.05)


def test_a_joint_yields_by_the_torque_over_the_stiffness() -> None:
    arm = Yielding({SPACE.name: "joint", "compliance.joint_stiffness": 50.0, "compliance.dead_zone": 0.0})
    before = arm.robot.state.arm.position.copy()
    torques = np.array([5.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    arm.robot.set_parameters({**arm.simulator, "push.effort": torques.tolist(), "push.duration": 100.0})
    arm.advance(2500)
    np.testing.assert_allclose(arm.robot.state.arm.position - before, torques / 50.0, atol=0.005)


def test_without_a_push_the_reference_is_the_planned_one_bit_for_bit() -> None:
    efforts = [Yielding({SPACE.name: space}, REAL).advance(500) for space in ("none", "tool", "joint")]
    np.testing.assert_array_equal(efforts[1], efforts[0])
    np.testing.assert_array_equal(efforts[2], efforts[0])


def test_a_tool_that_is_let_go_returns_exactly() -> None:
    arm = Yielding({SPACE.name: "tool"})
    arm.pushed(1, 30.0, 500)
    assert np.abs(arm.controller.state.compliance.offset[0]).max() > 0.01
    arm.pushed(1, 0.0, 6000)
    assert not arm.controller.state.compliance.offset.any()


@pytest.mark.parametrize("dead_zone", [0.0, [1.74] * 4 + [0.24] * 3], ids=["no dead zone", "dead zone"])
def test_a_wall_gets_no_more_than_the_limit_and_gains_that_change_make_no_step(
    tmp_path: Path, dead_zone: float | list[float]
) -> None:
    (tmp_path / "wall.xml").write_text(WALL, encoding="utf-8")
    soft = {**TOOL, "compliance.dead_zone": dead_zone, "compliance.stiffness": [150.0] * 3 + [50.0] * 3}
    arm = Yielding(soft, {"scene": str(tmp_path / "wall.xml")})
    arm.swing(0.166, 3000)
    efforts = arm.advance(1000)
    for change in ({"stiffness": [3000.0] * 3 + [50.0] * 3}, {"limit": [20.0] * 3 + [0.0] * 3}):
        arm.set(**change)
        steps, efforts = efforts[-1:], arm.advance(2000)
        assert np.abs(np.diff(np.vstack((steps, efforts[:500])), axis=0)).max() < 1.0
    arm.advance(1000)
    (wrench,) = arm.robot.contacts().values()
    # It is the forearm that touches, with a shorter lever than the tool.
    assert np.linalg.norm(wrench[:3]) == pytest.approx(20.0, rel=0.15)
    # It leaves the wall and returns.
    arm.swing(-0.166, 3000)
    arm.advance(2000)
    np.testing.assert_allclose(arm.robot.state.arm.position, START, atol=1e-3)


def test_friction_that_is_compensated_does_not_shake_an_arm_at_a_wall(tmp_path: Path) -> None:
    """The velocity of what yields changes its sign there; that of the planned motion does not."""
    (tmp_path / "wall.xml").write_text(WALL, encoding="utf-8")
    rubbing = np.array([4.35] * 4 + [0.6] * 3)
    real = {"friction.coulomb": rubbing.tolist(), "friction.bristle_stiffness": 1000.0, **HEAVIER}
    known = {SPACE.name: "tool", "compensation.coulomb": (0.8 * rubbing).tolist()}
    arm = Yielding(known, {"scene": str(tmp_path / "wall.xml"), **real})
    arm.swing(0.166, 3000)
    arm.advance(1000)
    assert np.abs(np.diff(arm.advance(2000), axis=0)).max() < 1.0


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"law.disturbance_rejection": False}, r"compliance\.space: set law\.disturbance_rejection to true"),
        ({"compliance.inertia": 0.5}, r"compliance\.inertia: 0\.5 .*1"),
        ({"compliance.stiffness": [100.0] * 3}, r"compliance\.stiffness: .*6"),
    ],
)
def test_what_would_be_unstable_or_incomplete_is_refused(settings: dict[str, Any], reason: str) -> None:
    observer = {"estimator.name": "extended_state_observer", "law.disturbance_rejection": True}
    with pytest.raises(ParameterError, match=reason):
        resolve(controller_schema, {"robot.description": "panda", **observer, **TOOL, **settings}, 7)


@pytest.mark.parametrize("torque", [np.nan, np.inf, 1e300])
def test_an_absurd_torque_from_outside_is_not_integrated(torque: float) -> None:
    arm = Yielding(TOOL)
    arm.controller.state.external[:] = torque
    arm.controller.state.compliance.offset[1] = torque
    arm.advance(3)
    assert np.isfinite(arm.controller.signals[Signal.EFFORT]).all()
    assert np.isfinite(arm.controller.state.compliance.offset).all()
