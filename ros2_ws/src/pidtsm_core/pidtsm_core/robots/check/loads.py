"""What the joints of an arm carry and accelerate over its range, and doubts about it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.base import Robot, unit_accelerations
from pidtsm_core.robots.check.result import Doubt, JointFacts, Load
from pidtsm_core.robots.payload import payload_of

_POSTURES, _BEST, _GRID, _ROUNDS = 200, 3, 13, 2
"""Random postures, those from which the search for the largest torque begins, points per joint, and rounds."""
_SLIDING = 0.5
"""Half the range of a sliding joint without limits, m."""
_UNSTEADY = 20.0
"""Acceleration by Coulomb friction, rad/s^2 or m/s^2, beyond which a loop cannot hold a joint steady: of public arms,
those up to 10 stay within 0.4 mrad, 20 is 3 mrad, 80 is 80 mrad (14-bit encoders, 1 ms of delay, `first_gains`)."""
_SLOW = 0.5
"""Acceleration under the largest effort that is too little for an arm, rad/s^2 or m/s^2."""
_LIGHT = 1e6
"""Acceleration under the largest effort that only a joint without rotor has; all arms with rotors are below 1e3."""

_STRONG = 1e4
"""The same of a joint with a rotor, whose effort limit is a mistake then."""


class _Statics:
    """Torque of gravity and inertia matrix of an arm."""

    def __init__(self, robot: Robot, settings: Mapping[str, Any]) -> None:
        self._robot, self._joints = robot, len(robot.joints)
        defaults = {f"robot.{each.name}": each.default for each in robot.parameters}
        self._p = robot.pack_model({name: settings.get(name, value) for name, value in defaults.items()})
        if "payload.mass" in settings:
            self._p = robot.with_payload(self._p, payload_of(settings))
        self._units = unit_accelerations(self._joints)

    def at(self, q: Array) -> tuple[Array, Array]:
        """Torque of gravity, shape (joints,), and inertia, shape (joints, joints), at q."""
        efforts = np.zeros_like(self._units)
        self._robot.dynamics.inverse_dynamics(q, np.zeros(self._joints), self._units, self._p, efforts)
        return efforts[0], efforts[1:] - efforts[0]

    def inertia(self, q: Array) -> Array:
        """Inertia that each joint accelerates while the others move freely, shape (joints,); 0: it has none."""
        matrix = self.at(q)[1]
        try:
            return np.maximum(1.0 / np.diag(np.linalg.inv(matrix)), 0.0)
        except np.linalg.LinAlgError:
            return np.zeros(self._joints)


def find_loads(robot: Robot, settings: Mapping[str, Any], rate: float) -> tuple[Load, ...]:
    """What each joint carries and accelerates.

    Args:
        robot: the arm.
        settings: parameters of the groups ``robot`` and ``payload`` that differ from their defaults.
        rate: Hz.
    """
    statics = _Statics(robot, settings)
    lower, upper = _box(robot)
    postures = np.random.default_rng(1).uniform(lower, upper, (_POSTURES, lower.size))
    postures[0] = robot.initial_position
    gravity = _largest_gravity(statics, postures, lower, upper)
    inertias = np.array([statics.inertia(q) for q in postures])
    least, most = inertias.min(axis=0), inertias.max(axis=0)
    damping = np.array(robot.damping or [0.0] * lower.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(damping > 0.0, damping / (rate * least), 0.0)
    return tuple(
        Load(name, *(float(values[j]) for values in (gravity, least, most, ratio)))
        for j, name in enumerate(robot.joints)
    )


def load_doubts(joints: Sequence[JointFacts], loads: Sequence[Load], rate: float) -> Iterator[Doubt]:
    """Doubts about used joints, from what they carry and accelerate."""
    for joint, load in zip(joints, loads, strict=True):
        yield from _weak(joint, load)
        yield from _light(joint, load, rate)


def _light(joint: JointFacts, load: Load, rate: float) -> Iterator[Doubt]:
    """Whether a joint moves too little for its friction, or for its motor."""
    unit, inertia, speed = ("N", "kg", "m") if joint.type == "prismatic" else ("N m", "kg m^2", "rad")
    moved = f"the {load.least_inertia:.2g} {inertia} that it moves"
    rotor = "" if joint.armature else "; it has no rotor inertia"
    add = "add the inertia of its rotor, times the square of the gear ratio (rotor_inertia, or robot.armature)"
    code = "too-light-for-friction" if joint.armature else "rotor-missing"
    if load.friction_ratio > 1.0:
        friction = f"its viscous friction, {joint.damping:g} {unit} s/{speed}"
        text = f"{friction}, stops {moved} within a period of {1e3 / rate:g} ms{rotor}"
        yield Doubt(code, "joint", joint.name, text, f"{add}, correct the friction, or raise the rate")
    elif joint.friction > _UNSTEADY * load.least_inertia:
        text = f"its Coulomb friction, {joint.friction:g} {unit}, is too large for {moved} to be steady{rotor}"
        yield Doubt(code, "joint", joint.name, text, f"{add}, or correct the friction")
    elif joint.armature == 0.0 and np.isfinite(joint.effort) and joint.effort > _LIGHT * load.least_inertia:
        text = f"its motor, {joint.effort:g} {unit}, is too strong for {moved}{rotor}"
        yield Doubt(code, "joint", joint.name, text, f"{add}, or correct the inertia of its link")
    elif joint.armature > 0.0 and np.isfinite(joint.effort) and joint.effort > _STRONG * load.least_inertia:
        text = f"its effort limit, {joint.effort:g} {unit}, is too large for {moved}"
        yield Doubt("effort-large", "joint", joint.name, text, f"correct it, in {unit}, or the inertia of the rotor")


def _weak(joint: JointFacts, load: Load) -> Iterator[Doubt]:
    unit = "N" if joint.type == "prismatic" else "N m"
    if load.gravity > joint.effort:
        yield Doubt(
            "too-weak-for-gravity",
            "joint",
            joint.name,
            f"it cannot carry the arm everywhere: gravity takes up to {load.gravity:.3g} {unit} of its "
            f"{joint.effort:g} {unit}",
            "correct its effort limit, or the masses that it carries",
        )
    elif joint.effort < _SLOW * load.largest_inertia < np.inf:
        moved, acceleration = ("kg", "m/s^2") if joint.type == "prismatic" else ("kg m^2", "rad/s^2")
        yield Doubt(
            "too-weak-to-move",
            "joint",
            joint.name,
            f"its {joint.effort:g} {unit} accelerate the {load.largest_inertia:.3g} {moved} that it moves by only "
            f"{joint.effort / load.largest_inertia:.2g} {acceleration}",
            "correct its effort limit, the inertia of its rotor, or the masses that it carries",
        )
    elif joint.friction > 0.0 and joint.friction >= joint.effort:
        yield Doubt(
            "too-weak-for-friction",
            "joint",
            joint.name,
            f"its friction, {joint.friction:g} {unit}, is not below its effort limit, {joint.effort:g} {unit}",
            "correct one of them",
        )


def _box(robot: Robot) -> tuple[Array, Array]:
    """Range of the postures that are tried, each of shape (joints,), rad or m: at most a turn."""
    limits = robot.position_limits or [(-np.inf, np.inf)] * len(robot.joints)
    half = np.where(robot.slides or [False] * len(limits), _SLIDING, np.pi)
    lower, upper = np.array(limits, dtype=np.float64).T
    middle = np.array(robot.initial_position)
    wide = (upper - lower > 2.0 * half) & ~(np.isfinite(upper - lower) & (half == _SLIDING))
    return np.where(wide, middle - half, lower), np.where(wide, middle + half, upper)


def _largest_gravity(statics: _Statics, postures: Array, lower: Array, upper: Array) -> Array:
    """Largest torque of gravity at each joint, shape (joints,): joint by joint, from the best of many postures."""
    torques = np.abs([statics.at(q)[0] for q in postures])
    found = torques.max(axis=0)
    for j in np.flatnonzero(found > 0.0):
        for best in np.argsort(torques[:, j])[-_BEST:]:
            q = postures[best].copy()
            for k in list(range(q.size)) * _ROUNDS:
                tried = np.linspace(lower[k], upper[k], _GRID)
                values = [abs(statics.at(np.concatenate([q[:k], [x], q[k + 1 :]]))[0][j]) for x in tried]
                q[k] = tried[int(np.argmax(values))]
                found[j] = max(found[j], *values)
    return found
