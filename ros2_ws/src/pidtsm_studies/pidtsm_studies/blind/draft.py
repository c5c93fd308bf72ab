"""A blind arm in the making: what the controller believes, and the plant that faults change."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.hardware_classes import hardware_content
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.parameters.files import flatten
from pidtsm_core.robots import DESCRIPTION, Description, find_description
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree_robot import add_load

_STATES = 200
"""Of the motion, at which two models are compared."""
_SEEN = 0.06
"""Share of the efforts of all joints that friction and rotors leave of a difference that is seen."""
_OF_LIMIT, _OF_FRICTION = 0.03, 1.5
"""Parts of effort limit and friction that count as effort: what differs by less is hardly seen."""


@dataclass
class Draft:
    """Everything about a blind arm that faults may change.

    Attributes:
        arm: what the controller believes.
        hardware: class of hardware; empty: ideal.
        plant: URDF of the arm as it is.
        duration: s.
        amplitude, frequency, phase, middle: of the sines that are the motion: rad or m, Hz, rad, rad or m, (joints,).
        simulator, controller, trajectory: parameters that differ from those of the class and of the practical gains.
        rings: index of the joint whose gains shall be too high; None: none.
        points: rows of time (s) and positions of a file that replaces the sines; empty: the sines.
    """

    arm: Description
    hardware: str
    duration: float
    amplitude: Array
    frequency: Array
    phase: Array
    middle: Array
    plant: str = ""
    simulator: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)
    trajectory: dict[str, Any] = field(default_factory=dict)
    rings: int | None = None
    points: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def friction(self) -> float:
        """Coulomb friction of the class of hardware, as a share of the effort limit."""
        return of_class(self.hardware, "friction.coulomb", 0.0)

    @property
    def limit(self) -> Array:
        """Effort limits of the description, shape (joints,), N m or N."""
        return self.arm.effort

    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Desired positions, velocities and accelerations at times (s), shape (times, joints) each."""
        omega = 2.0 * np.pi * self.frequency
        angle = omega * time[:, np.newaxis] + self.phase
        wave, slope = np.sin(angle), np.cos(angle)
        return (
            self.middle + self.amplitude * wave,
            self.amplitude * omega * slope,
            -self.amplitude * omega**2 * wave,
        )

    def efforts(self, plant: str = "", payload: Payload | None = None) -> Array:
        """Efforts that the motion needs without friction, shape (states, joints), N m or N.

        Args:
            plant: URDF of the arm; empty: the one of the controller.
            payload: what it carries.
        """
        arm = self.arm if not plant else self.described(plant)
        tree = arm.tree.copy()
        if payload is not None:
            add_load(arm, tree, payload)
        pi = described_parameters(tree, 0.0 * arm.damping, 0.0 * arm.friction)
        motion = self.motion(np.linspace(0.0, self.duration, _STATES))
        return np.asarray(regressor(tree, *motion) @ pi)

    def described(self, plant: str) -> Description:
        """A plant, with the joints of the controller in its order."""
        return find_description({DESCRIPTION.name: plant, "joints": list(self.arm.joints)})

    def effect(self, plant: str = "", payload: Payload | None = None) -> float:
        """How far a plant differs from what the controller believes: the largest deviation of a joint's effort
        difference, as a share of the RMS of its effort with its friction; 0 if an offset, friction and rotors, which no
        description knows, explain nearly all of it.
        """
        believed = self.efforts()
        size = np.sqrt(np.mean(believed**2, axis=0)) + (_OF_LIMIT + _OF_FRICTION * self.friction) * self.limit
        difference = (self.efforts(plant, payload) - believed) / size
        left = self._unexplained(difference)
        return float(np.std(difference, axis=0).max()) if np.sqrt(np.mean(left**2)) > _SEEN else 0.0

    def _unexplained(self, difference: Array) -> Array:
        """What offset, rotor, viscous and Coulomb friction of each joint leave, shape (states, joints)."""
        _, velocity, acceleration = self.motion(np.linspace(0.0, self.duration, _STATES))
        left = np.empty_like(difference)
        for j, each in enumerate(difference.T):
            dq = velocity[:, j]
            columns = np.stack([np.ones_like(dq), acceleration[:, j], dq, np.sign(dq)], axis=1)
            left[:, j] = each - columns @ np.linalg.lstsq(columns, each, rcond=None)[0]
        return left


def of_class(hardware: str, name: str, default: float) -> float:
    """What a class of hardware has for a parameter, also one relative to the effort limit; without a class, default."""
    if not hardware:
        return default
    content = hardware_content(hardware)
    groups = [flatten(content.get(key) or {}, key) for key in ("simulator", "relative")]
    return float({**groups[0], **groups[1]}.get(name, default))
