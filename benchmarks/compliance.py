"""How soft an arm is: the impedance law, and a reference that yields on a robust loop, with MuJoCo as the judge.

    ./pidtsm shell -c "python benchmarks/compliance.py"

The Panda is pushed on its tool, and pushes a wall. Rows are what was measured; columns are the two ways, each with an
exact model; with masses and inertias 20 % larger than modelled and friction of 5 % of the effort limits, which sticks
and is not compensated; and the same with 80 % of the friction compensated.
"""

import argparse
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import scipy.linalg

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller
from pidtsm_core.control.state import External
from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.poses.wrench import ToolWrench
from pidtsm_core.robots import find_description, find_robot
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_core.trajectories.tool import ToolJacobian

START = np.array([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8])
WALL = '<mujoco><worldbody><geom type="box" size="0.5 0.05 1" pos="0.6 0.16 0.5" {}/></worldbody></mujoco>'
"""A wall 5 cm beside the last link."""
HARD = 'solref="0.002 1"'
"""A hundred times as stiff as MuJoCo's walls are."""
BEYOND = 0.166
"""Angle of the first joint at which the reference is 5 cm beyond the wall, rad."""
PERIOD = 0.001
SIDE = 1
"""The axis that the wall is perpendicular to: y."""
RUBBING = [4.35] * 4 + [0.6] * 3
_CONDITIONS: Mapping[str, Mapping[str, Any]] = {
    "exact": {"friction.coulomb": 0.0, "friction.viscous": 0.0},
    "wrong": {
        "friction.coulomb": RUBBING,
        "friction.bristle_stiffness": 1000.0,
        "friction.viscous": 0.0,
        "model_error.mass": 0.2,
        "model_error.inertia": 0.2,
    },
}
CONDITIONS = {**_CONDITIONS, "known friction": _CONDITIONS["wrong"]}
KNOWN = 0.8
"""Share of the friction that is compensated in the last one."""
WAYS = ("impedance", "compliance")
SETTLED = 2.0
"""Time in which the arm comes to rest, and what acts on it is taken for none, s."""


class Settings(NamedTuple):
    """How the tool shall yield: stiffness in N/m, damping ratio, limit of the force in N (0: none)."""

    stiffness: float
    damping: float = 1.0
    limit: float = 0.0
    rotational: float = 50.0

    def of(self, way: str) -> dict[str, Any]:
        """As parameters of the controller."""
        k = self.stiffness
        if way == "impedance":
            return {
                **{f"law.stiffness_{axis}": k for axis in "xyz"},
                "law.rotational_stiffness": self.rotational,
                "law.damping_ratio": self.damping,
                "law.force_limit": self.limit,
            }
        return {
            "compliance.space": "tool",
            "compliance.stiffness": [k, k, k, *[self.rotational] * 3],
            "compliance.damping": self.damping,
            "compliance.limit": [self.limit] * 3 + [0.0] * 3,
        }


class Arm:
    """A Panda under control, on MuJoCo.

    Attributes:
        tool, efforts, forces: of each sample: position of the tool (m), commanded efforts (N m), force of the wall (N).
    """

    def __init__(self, way: str, condition: str, settings: Settings, scene: str = "", sensors: bool = False) -> None:
        simulator = {"engine": "mujoco", "initial_position": START.tolist(), "scene": scene, **CONDITIONS[condition]}
        if sensors:
            simulator |= {"encoder.bits": 14, "delay.samples": 1}
        known = np.multiply(KNOWN if condition == "known friction" else 0.0, RUBBING).tolist()
        controller = {"compensation.coulomb": known, "compensation.viscous": 0.0, **settings.of(way)}
        law = "impedance" if way == "impedance" else "piddtsm"
        rest = {"reference.name": "sines", "reference.amplitude": 0.0, "reference.offset": START.tolist()}
        given = {"simulator": simulator, "controller": controller, "trajectory": rest}
        made = make_experiment(None, law, 1.0, PRACTICAL, given, "panda").values
        self.way, self.values = way, made["controller"]
        self.controller, self.robot = Controller(self.values), SimulatedRobot(made["simulator"])
        self.jacobian = ToolJacobian(find_robot(self.values), self.values)
        self.wrench = ToolWrench(find_robot(self.values), self.values)
        self.desired, self.sample = np.array([START, 0.0 * START, 0.0 * START]), 0
        self.tool = self.efforts = np.empty((0, 3))
        self.forces = np.empty(0)
        self.run(SETTLED)

    def set(self, settings: Settings) -> None:
        """Other settings from the next sample on."""
        self.values = {**self.values, **settings.of(self.way)}
        self.controller.set_parameters(self.values)

    def run(self, duration: float, path: Callable[[float], tuple[float, float, float]] | None = None) -> None:
        """Go on; `path` gives position, velocity and acceleration of the first joint beside its start (rad)."""
        samples = round(duration / PERIOD)
        tool, efforts, self.forces = np.empty((samples, 3)), np.empty((samples, 7)), np.zeros(samples)
        for k in range(samples):
            sample, position = self.robot.sense(self.sample)
            if path is not None:
                self.desired[:, 0] = path(k * PERIOD)
                self.desired[0, 0] += START[0]
            if sample >= 0:
                self.controller.reference[:] = self.desired
                self.controller.position[:] = position
                self.controller.step(sample * 1_000_000, sample * 1_000_000)
            self.robot.act(self.sample, sample >= 0, self.controller.effort)
            tool[k], efforts[k] = self.jacobian.at(self.robot.state.arm.position)[0], self.controller.effort
            self.forces[k] = sum(float(np.linalg.norm(wrench[:3])) for wrench in self.robot.contacts().values())
            self.sample += 1
        self.tool, self.efforts = tool, efforts

    @property
    def felt(self) -> float:
        """The force that the controller publishes as that on the tool, N."""
        state = self.controller.state
        acting = state.external[External.TWICE] - state.compliance.usual
        return float(np.linalg.norm(self.wrench.of(self.controller.position, acting)[:3]))


def push(arm: Arm, force: Array, duration: float) -> Array:
    """Displacement of the tool (m) at the end of a push with a wrench, shape (6,)."""
    before = arm.tool[-1].copy()
    arm.robot.push(force)
    arm.run(duration)
    return np.asarray(arm.tool[-1] - before)


def stiffness(way: str, condition: str, k: float, sensors: bool = False) -> float:
    """What the tool renders, N/m: the slope between two pushes to the side, the second on top of the first."""
    arm, force = Arm(way, condition, Settings(k), sensors=sensors), np.zeros(6)
    moved = []
    for share in (1.0, 2.0):
        force[SIDE] = share * max(0.02 * k, 15.0)
        moved.append(push(arm, force, 4.0)[SIDE])
    return float(0.5 * force[SIDE] / moved[1])


def mode() -> Array:
    """A displacement of the tool that moves on its own on equal springs, from MuJoCo's inertia and Jacobian."""
    description = find_description({"robot.description": "panda"})
    model = mujoco.MjModel.from_xml_string(description.text)
    for row in rows(description.tree):
        model.dof_armature[int(row[Column.PLACE])] = row[Column.ARMATURE]
    data = mujoco.MjData(model)
    data.qpos[:] = START
    mujoco.mj_forward(model, data)
    inertia, jacobian = np.zeros((7, 7)), np.zeros((6, 7))
    for column, unit in zip(inertia, np.eye(7), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    body = model.body("panda_link7").id
    point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ description.tool
    mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], point, body)
    felt = np.linalg.inv(jacobian @ np.linalg.solve(inertia, jacobian.T))
    found = scipy.linalg.eigh(np.diag([1000.0] * 3 + [50.0] * 3), felt)[1]
    return np.asarray(found[:, 0] / np.abs(found[:3, 0]).max())


def damping(way: str, condition: str, ratio: float) -> float:
    """What the tool renders: it is let go, and the overshoot of one mode is exp(-pi ratio / sqrt(1 - ratio^2))."""
    arm, direction = Arm(way, condition, Settings(1000.0, ratio)), mode()
    before = arm.tool[-1].copy()
    wrench = 0.03 * direction * np.repeat([1000.0, 50.0], 3)
    push(arm, wrench, 3.0)
    pressed = (arm.tool[-1] - before) @ direction[:3]
    arm.robot.push(np.zeros(6))
    arm.run(2.5)
    course = (arm.tool - before) @ direction[:3]
    decrement = -np.log(max((course[-1] - course.min()) / (pressed - course[-1]), 1e-9))
    return float(decrement / np.hypot(np.pi, decrement))


def into_wall(t: float) -> tuple[float, float, float]:
    """Quintic of the first joint in 3 s."""
    s = min(t / 3.0, 1.0)
    return (
        BEYOND * s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        BEYOND / 3.0 * 30.0 * s**2 * (1.0 - s) ** 2,
        BEYOND / 9.0 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


def out_of_wall(t: float) -> tuple[float, float, float]:
    """And back."""
    q, dq, ddq = into_wall(t)
    return BEYOND - q, -dq, -ddq


class Pressed(NamedTuple):
    """A wall that was pressed: force and what the controller says of it (N), largest change of a torque from sample to
    sample while pressing and leaving (N m), where the tool was 2 s after it had left (mm off its start), ripple (N).
    """

    force: float
    felt: float
    step: float
    left: float
    ripple: float


def press(
    way: str, condition: str, settings: Settings, duration: float, sensors: bool = False, wall: str = ""
) -> Pressed:
    """Press a wall for `duration` (s), and leave it."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "wall.xml")
        scene.write_text(WALL.format(wall), encoding="utf-8")
        arm = Arm(way, condition, settings, str(scene), sensors)
        start = arm.tool[-1].copy()
        arm.run(3.0, into_wall)
        arm.run(duration)
        force, felt, ripple = arm.forces[-1000:].mean(), arm.felt, arm.forces[-1000:].std()
        step = np.abs(np.diff(arm.efforts, axis=0)).max()
        arm.run(3.0, out_of_wall)
        step = max(step, np.abs(np.diff(arm.efforts, axis=0)).max())
        arm.run(2.0)
        return Pressed(force, felt, float(step), 1e3 * float(np.linalg.norm(arm.tool[-1] - start)), ripple)


def change(way: str, condition: str) -> float:
    """Largest change of a torque from sample to sample (N m) when the stiffness changes by 20 in contact."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "wall.xml")
        scene.write_text(WALL.format(""), encoding="utf-8")
        arm = Arm(way, condition, Settings(150.0), str(scene))
        arm.run(3.0, into_wall)
        arm.run(2.0)
        largest = 0.0
        for k in (3000.0, 150.0):
            before = arm.efforts[-1]
            arm.set(Settings(k))
            arm.run(2.0)
            largest = max(largest, float(np.abs(np.diff(np.vstack((before, arm.efforts)), axis=0)).max()))
        return largest


def rendered(what: str, wanted: float, way: str, condition: str) -> str:
    """Cell for a stiffness or a damping ratio."""
    return (
        f"{stiffness(way, condition, wanted):.0f}" if what == "stiffness" else f"{damping(way, condition, wanted):.2f}"
    )


def table(long: float) -> None:
    """Print the rows."""
    columns = [(way, condition) for way in WAYS for condition in CONDITIONS]
    print("| | " + " | ".join(f"{way}, {condition}" for way, condition in columns) + " |")
    print("|" + " --- |" * (1 + len(columns)))

    def row(what: str, measure: Callable[[str, str], str]) -> None:
        print(f"| {what} | " + " | ".join(measure(*column) for column in columns) + " |", flush=True)

    for k in (100.0, 300.0, 1000.0, 3000.0):
        row(f"stiffness for {k:g} N/m", partial(rendered, "stiffness", k))
    for ratio in (0.3, 0.7):
        row(f"damping ratio for {ratio:g}", partial(rendered, "damping", ratio))
    for k in (1000.0, 3000.0):
        pressed = {column: press(*column, Settings(k), 5.0) for column in columns}
        row(f"wall, {k:g} N/m: force; as felt (N)", lambda *c, p=pressed: f"{p[c].force:.1f}; {p[c].felt:.1f}")
    for sensors in (False, True):
        pressed = {column: press(*column, Settings(1000.0), 5.0, sensors, HARD) for column in columns}
        which = "14-bit encoders, 1 ms of delay" if sensors else "perfect sensors"
        row(f"hard wall, {which}: ripple of the force (N)", lambda *c, p=pressed: f"{p[c].ripple:.2f}")
    pressed = {column: press(*column, Settings(1000.0, limit=20.0), long) for column in columns}
    row("the same, limit of 20 N: force (N)", lambda *c: f"{pressed[c].force:.1f}")
    row(f"after {long:g} s: largest change of a torque (N m)", lambda *c: f"{pressed[c].step:.2f}")
    row("2 s after it has left: off its place (mm)", lambda *c: f"{pressed[c].left:.2f}")
    row("stiffness times 20 in contact: torque step (N m)", lambda *c: f"{change(*c):.2f}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long", type=float, default=60.0, help="how long the wall is pressed, s")
    table(parser.parse_args().long)


if __name__ == "__main__":
    main()
