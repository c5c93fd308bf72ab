"""The gripper of a simulated arm: joints of the description beside those of the arm, and what they hold.

The fingers move as they are commanded, no faster than `gripper.velocity`, and stop at an object. Their motion has no
effect on the arm; the object has, while it is held.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float, did_you_mean
from pidtsm_core.parameters.joints import ABSURD, MessageError
from pidtsm_core.robots import ROBOTS, find_robot
from pidtsm_core.robots.other_joints import OtherJoint
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree_robot import TreeRobot

JOINTS = Parameter(
    "gripper.joints",
    "",
    "locked joints that gripper/gripper_cmd moves, and that joint_states contain: finger1 finger2; empty: no gripper",
    read_only=True,
)
_CLOSES = Parameter(
    "gripper.closes",
    "down",
    "whether the positions of the joints decrease or increase while the gripper closes",
    choices=("down", "up"),
)
_VELOCITY = Parameter(
    "gripper.velocity", 0.1, "largest velocity of the joints", "rad/s or m/s", minimum=0.0, exclusive=True
)
_MASS = Parameter(
    "gripper.object_mass", 0.0, "mass of the object that the gripper holds when it closes; 0: none", "kg", minimum=0.0
)
_AT = Parameter("gripper.object_at", 0.0, "position at which the closing joints touch the object", "rad or m")
_CENTER = Parameter(
    "gripper.object_center_of_mass",
    (0.0, 0.0, 0.0),
    "centre of mass of the object in the tool frame: x, y, z",
    "m",
    length=3,
)
PARAMETERS = (JOINTS, _CLOSES, _VELOCITY, _MASS, _AT, _CENTER)
_SAME = 1e-9
"""Positions are equal up to this, rad or m."""


def gripper_joints(values: Mapping[str, object]) -> dict[str, OtherJoint]:
    """The joints of the parameter `JOINTS`, in its order, as the description has them.

    Raises:
        ParameterError: the description has no such locked joint.
    """
    names = str(values.get(JOINTS.name, "")).replace(",", " ").split()
    if not names:
        return {}
    robot = find_robot(values)
    others = robot.description.others if isinstance(robot, TreeRobot) else {}
    found = {}
    for name in names:
        if name not in others:
            known = f"there are {', '.join(others)}" if others else "there is none"
            why = "belongs to the arm" if name in robot.joints else "is no joint"
            if robot.name in ROBOTS:
                known = f"{robot.name} is a closed form; name the URDF of the arm"
            hint = did_you_mean(name, tuple(others))
            raise ParameterError(f"{JOINTS.name}: {name} {why}: it must be locked; {known}{hint}", JOINTS.name)
        found[name] = others[name]
    if all(joint.mimics in found for joint in found.values()):
        raise ParameterError(f"{JOINTS.name}: each joint mimics another; add the one that they follow", JOINTS.name)
    return found


class Gripper:
    """The joints of a gripper, and the object that they hold.

    Attributes:
        joints: their names; empty: there is no gripper.
        position: shape (joints,), rad or m.
        velocity: shape (joints,), rad/s or m/s.
        object: what it holds when it closes, in the tool frame; without a mass: nothing.
        effort_limit: the last one that was commanded, N or N m; 0: none.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        """Begin at rest where the joints are locked; `values`: every parameter of a simulator.

        Raises:
            ParameterError: see `gripper_joints`.
        """
        found = gripper_joints(values)
        self.joints = tuple(found)
        self._joints = tuple(found.values())
        self._leading = [j for j, joint in enumerate(self._joints) if joint.mimics not in found]
        self.position, self.velocity = np.zeros(len(found)), np.zeros(len(found))
        self.effort_limit = 0.0
        self.object = Payload(0.0)
        self._holds = False
        if found:
            robot = find_robot(values)
            assert isinstance(robot, TreeRobot)
            self.position[:] = [robot.description.locked[name] for name in self.joints]
            self._follow()
        self.set_parameters(values)
        self.stop()

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other values; the joints keep their position."""
        self._sense = 1.0 if values[_CLOSES.name] == "up" else -1.0
        self._fastest = as_float(values[_VELOCITY.name])
        self._at = as_float(values[_AT.name])
        mass, center = as_float(values[_MASS.name]), np.array(values[_CENTER.name], dtype=np.float64)
        if mass != self.object.mass or (center != self.object.center_of_mass).any():
            self.object = Payload(mass, center)

    @property
    def leader(self) -> int:
        """Index of the first joint that follows no other."""
        return self._leading[0]

    @property
    def held(self) -> Payload | None:
        """The object that is held, in the tool frame; None: there is none."""
        return self.object if self._holds and self.object.mass > 0.0 else None

    @property
    def reached(self) -> bool:
        """Whether the joints are where the last command ends."""
        done = self._passed >= self._times[-1]
        return bool(done and np.abs(self.position[self._leading] - self._points[-1]).max() <= _SAME)

    @property
    def stalled(self) -> bool:
        """Whether the object keeps the joints from going on."""
        return self._holds

    def stop(self) -> None:
        """Stay."""
        self._begin(np.zeros(1), self.position[np.newaxis, self._leading].copy(), self._fastest)

    def follow(
        self, names: Sequence[str], times: Sequence[float], points: Sequence[Sequence[float]], fastest: float = 0.0
    ) -> None:
        """Begin a motion, and forget the last one.

        Args:
            names: joints; those that mimic others may be absent.
            times: of the points, from now on, s, increasing.
            points: positions, shape (points, names), rad or m, joined by straight lines.
            fastest: velocity that is not exceeded, rad/s or m/s; 0: `gripper.velocity`.

        Raises:
            MessageError: a joint is missing, unknown or named twice, a number is not finite or out of range.
        """
        self._check_names(names)
        given = np.array(points, dtype=np.float64).reshape(len(times), len(names)) if len(times) else np.zeros((0, 1))
        ticks = np.array(times, dtype=np.float64)
        if not ticks.size:
            raise MessageError("there are no points")
        if not (np.abs(ticks) < ABSURD).all() or ticks[0] < 0.0 or (np.diff(ticks) <= 0.0).any():
            raise MessageError("the times of the points do not increase from 0 on")
        if not (math.isfinite(fastest) and fastest >= 0.0):
            raise MessageError("the velocity is not finite, or negative")
        columns = [list(names).index(self.joints[j]) for j in self._leading]
        chosen = given[:, columns]
        for j, column in zip(self._leading, chosen.T, strict=True):
            joint, name = self._joints[j], self.joints[j]
            if not np.isfinite(column).all():
                raise MessageError(f"the position of {name} is not finite")
            if column.min() < joint.lower - _SAME or column.max() > joint.upper + _SAME:
                raise MessageError(f"{name} is to leave its range, {joint.lower:g} to {joint.upper:g}")
        self._begin(ticks, chosen, min(fastest or self._fastest, self._fastest))

    def close_to(self, position: float) -> None:
        """Bring all joints to one position, rad or m; raises as `follow`."""
        names = [self.joints[j] for j in self._leading]
        self.follow(names, [0.0], [[position] * len(names)])

    def advance(self, dt: float) -> None:
        """Let dt (s) pass."""
        self._passed += dt
        before = self.position.copy()
        now = self.position[self._leading]
        wanted = np.array([np.interp(self._passed, self._times, column) for column in self._points.T])
        after = now + np.clip(wanted - now, -self._limit * dt, self._limit * dt)
        self._holds = False
        if self.object.mass > 0.0:
            meets = (self._sense * (now - self._at) <= _SAME) & (self._sense * (after - self._at) > _SAME)
            after[meets] = self._at
            self._holds = bool(meets.all())
        self.position[self._leading] = after
        self._follow()
        self.velocity[:] = (self.position - before) / dt

    def _begin(self, times: Array, points: Array, fastest: float) -> None:
        if times[0] > 0.0:  # From where the joints are.
            times = np.concatenate([[0.0], times])
            points = np.concatenate([self.position[np.newaxis, self._leading], points])
        self._times, self._points, self._limit, self._passed = times, points, fastest, 0.0

    def _follow(self) -> None:
        """Bring the joints that mimic others to where these lead them."""
        for j, joint in enumerate(self._joints):
            if joint.mimics in self.joints:
                self.position[j] = joint.factor * self.position[self.joints.index(joint.mimics)] + joint.offset

    def _check_names(self, names: Sequence[str]) -> None:
        expected = ", ".join(self.joints)
        unknown = [name for name in names if name not in self.joints]
        missing = [self.joints[j] for j in self._leading if self.joints[j] not in names]
        if unknown or missing or len(set(names)) < len(names):
            what = f"unknown joints {', '.join(unknown)}" if unknown else f"joints {', '.join(missing)} are missing"
            if not unknown and not missing:
                what = "a joint is named twice"
            raise MessageError(f"{what}; the gripper has {expected}")
