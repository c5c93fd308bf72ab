"""What the description of an arm says about torques, for the conclusions of the steps."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.parameters import joint_array, resolve
from pidtsm_core.robots import find_robot, payload_of, robot_joints

_WIDEST = np.pi
"""rad; range to either side of the middle where no limit is described."""
_SHARE = 0.9
"""Of the range of positions that steps use."""
_BEYOND = 0.1
"""rad or m; farther beyond a described limit, no joint is."""
_QUICKEST = 1.5
"""rad/s or m/s, where the description has no limit of the velocity."""


class ArmModel:
    """The rigid bodies of an arm by the parameters of its controller.

    Attributes:
        joints: names.
        effort: limits, shape (joints,), N m or N.
        lower, upper: positions that steps may use, likewise, rad or m.
        velocity: limits, likewise, rad/s or m/s.
        slides: whether each joint slides, likewise.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        """Args: settings: parameters of the controller that differ from their defaults.

        Raises:
            ParameterError: the arm cannot be used.
        """
        self._robot = find_robot(settings)
        joints = robot_joints(settings)
        values = resolve(controller_schema, settings, joints)
        self._model = self._robot.with_payload(self._robot.pack_model(values), payload_of(values))
        self.joints = self._robot.joints
        self.effort = joint_array(values["limits.effort"], joints)
        middle = np.array(self._robot.initial_position)
        given = self._robot.position_limits
        lower, upper = np.array(given).T if given else (middle - _WIDEST, middle + _WIDEST)
        least, most = np.array(given).T if given else (np.full(joints, -np.inf), np.full(joints, np.inf))
        self._least, self._most = least - _BEYOND, most + _BEYOND
        lower, upper = np.maximum(lower, middle - _WIDEST), np.minimum(upper, middle + _WIDEST)
        self.lower, self.upper = (middle + _SHARE * (each - middle) for each in (lower, upper))
        quick = self._robot.velocity_limit
        self.velocity = np.minimum(np.array(quick), _QUICKEST) if quick else np.full(joints, _QUICKEST)
        self.slides = np.array(self._robot.slides or [False] * joints)

    def may_be(self, q: Array) -> NDArray[np.bool_]:
        """Whether each joint may be at the position q by its described limits, both of shape (joints,)."""
        return np.asarray((q >= self._least) & (q <= self._most))

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques of states, each of shape (samples, joints), without friction, likewise."""
        efforts, one = np.empty(q.shape), np.empty((1, q.shape[1]))
        for k, (each, rate, second) in enumerate(zip(q, dq, ddq, strict=True)):
            self._robot.dynamics.inverse_dynamics(each.copy(), rate.copy(), second[np.newaxis].copy(), self._model, one)
            efforts[k] = one[0]
        return efforts

    def gravity(self, q: Array) -> Array:
        """Torques that hold postures, shape (samples, joints)."""
        return self.torque(q, 0.0 * q, 0.0 * q)

    def inertia(self, q: Array) -> Array:
        """The inertia matrix at q, shape (joints, joints), kg m^2."""
        return self._robot.inertia_matrix(self._model, q)
