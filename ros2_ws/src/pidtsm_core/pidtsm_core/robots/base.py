"""Interface of a robot model."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.parameters.family import Member
from pidtsm_core.robots.payload import Payload
from pidtsm_core.units import JointUnits, joint_units


@dataclass(frozen=True)
class Dynamics:
    """Compiled functions of a kind of robot model; `p` are the model's parameters, as `Robot.pack_model` returns them.

    Attributes:
        inverse_dynamics: ``(q, dq, ddq, p, effort)``; ddq has shape (n, joints), one acceleration per row; writes the
            effort that causes row i at q, dq to row i of effort.
        forward_dynamics: ``(q, dq, effort, p, ddq)``; writes ddq, shape (joints,).
        energy: ``(q, dq, p)``; kinetic plus potential energy in J.
        effort_spread: ``(q, dq, ddq, box, p, spread)``; ddq has shape (joints,); writes how far the efforts are at most
            from those of this state, while q, q', q'' are within `box`, shape (3, joints), of it, to the first row of
            `spread`, shape (3, joints), whose other rows are scratch. It is called after `inverse_dynamics` of this
            state with the same `p`. None: twice the differences at the faces of the box, see `spread_of_differences`.
    """

    inverse_dynamics: Callable[[Array, Array, Array, Array, Array], None]
    forward_dynamics: Callable[[Array, Array, Array, Array, Array], None]
    energy: Callable[[Array, Array, Array], float]
    effort_spread: Callable[[Array, Array, Array, Array, Array, Array], None] | None = None


class Model(NamedTuple):
    """The model of a robot as compiled code reads it, for `inverse_dynamics` and `forward_dynamics`."""

    kind: int  # place of its dynamics among those with a closed form; beyond the last: called by address
    inverse: int  # address of the inverse dynamics
    forward: int  # address of the forward dynamics
    spread: int  # address of the effort spread; 0: that of a tree
    parameters: Array  # as `Robot.pack_model` returns them


class Tool(NamedTuple):
    """Where the tool is, for wrenches on it; see `tree.add_wrench`."""

    tree: Array  # the joints as a tree, shape (size(joints),); its masses do not matter
    row: int  # row of the link that carries the tool; -1: it is not known
    point: Array  # origin of the tool in that link, shape (3,), m


NO_TOOL = Tool(np.zeros(0), -1, np.zeros(3))
"""Of an arm whose geometry is not known."""


def unit_accelerations(joints: int) -> Array:
    """No acceleration, and the unit vectors, shape (joints + 1, joints): their efforts give bias and inertia matrix."""
    return np.vstack([np.zeros(joints), np.eye(joints)])


@dataclass(frozen=True)
class Robot(Member):
    """A rigid manipulator, eq. (1): H(q) q'' + C(q, q') q' + G(q) = effort.

    A joint that slides has m instead of rad, and N instead of N m.

    Attributes:
        joints: default names of its joints; they also define the number of joints.
        effort_limit: default effort limits, N m, one per joint; infinite if there is none.
        initial_position: default start position, rad, one value per joint.
        position_limits: smallest and largest position of each joint, rad; infinite if there is none; empty: no limits.
        quantities: names of the parameters that are masses, inertias or lengths; the keys are ``mass``, ``inertia``
            and ``length``.
        dynamics: its compiled functions.
        load: adds a payload to packed parameters.
        slides: whether each joint slides; empty: all turn.
        continuous: whether each joint turns without end, so that positions a turn apart are the same; empty: none does.
        disturbance: name of the default disturbance of the simulated arm.
        velocity_limit: default velocity limits, rad/s, one per joint; infinite if there is none; empty: no limits.
        friction, damping: Coulomb and viscous friction, N m and N m s/rad, one per joint; the defaults of the simulated
            arm and of the controller; empty: none.
        tool: its tool for these packed parameters; None: it is not known where the tool is.
        rotor: the inertias of its rotors as the joints see them for these packed parameters, kg m^2, shape (joints,);
            None: its model does not define them.
        mjcf: the text of an MJCF of these packed parameters, for MuJoCo, see `text_bodies`; None: there is none.
        rigid: values of parameters with which a closed form moves as a rigid body does; empty: with any.
        base: name of its base link.
        urdf: source of a URDF with these joints, see `read_source`, which viewers show; empty: they show nothing.
    """

    joints: tuple[str, ...]
    effort_limit: tuple[float, ...]
    initial_position: tuple[float, ...]
    quantities: Mapping[str, tuple[str, ...]]
    dynamics: Dynamics
    load: Callable[[Array, Payload], None]
    disturbance: str = "none"
    position_limits: tuple[tuple[float, float], ...] = ()
    velocity_limit: tuple[float, ...] = ()
    slides: tuple[bool, ...] = ()
    continuous: tuple[bool, ...] = ()
    friction: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()
    tool: Callable[[Array], Tool] | None = None
    rotor: Callable[[Array], Array] | None = None
    mjcf: Callable[[Array], str] | None = None
    rigid: Mapping[str, str] = field(default_factory=dict)
    base: str = "base_link"
    urdf: str = ""

    def pack_model(
        self, values: Mapping[str, Value], group: str = "robot", factors: Mapping[str, float] | None = None
    ) -> Array:
        """Model parameters as the compiled functions read them, shape (parameters,), in their order.

        A parameter with choices is packed as the index of the choice.

        Args:
            values: parameter values by full name.
            group: group of the parameters.
            factors: by quantity (see `quantities`); the parameters of the quantity are multiplied by its factor.
        """
        factor = {name: f for quantity, f in (factors or {}).items() for name in self.quantities[quantity]}
        packed = []
        for parameter in self.parameters:
            value = values[f"{group}.{parameter.name}"]
            if parameter.choices:
                packed.append(float(tuple(parameter.choices).index(str(value))))
            else:
                packed.append(as_float(value) * factor.get(parameter.name, 1.0))
        return np.array(packed)

    @property
    def units(self) -> tuple[JointUnits, ...]:
        """Units of each joint."""
        return joint_units(self.slides, len(self.joints))

    def with_payload(self, model: Array, payload: Payload) -> Array:
        """A copy of packed parameters, shape (parameters,), in SI units, with a payload at the tool."""
        loaded = model.copy()
        self.load(loaded, payload)
        return loaded

    def rotors(self, model: Array) -> Array:
        """Inertias of the rotors as the joints see them for packed parameters, shape (joints,), kg m^2; 0: unknown."""
        return np.zeros(len(self.joints)) if self.rotor is None else self.rotor(model)

    def inertia_matrix(self, model: Array, q: Array) -> Array:
        """The inertia matrix with the rotors, shape (joints, joints), kg m^2.

        Args:
            model: packed parameters.
            q: positions, shape (joints,), rad.
        """
        rows = unit_accelerations(q.size)
        efforts = np.zeros_like(rows)
        self.dynamics.inverse_dynamics(q, np.zeros(q.size), rows, model, efforts)
        inertia = efforts[1:] - efforts[0]
        return np.asarray(0.5 * (inertia + inertia.T))

    def joint_inertia(self, model: Array, q: Array) -> Array:  # noqa: ARG002
        """Inertia that the effort of each joint accelerates at q (rad), 1 / (H^-1)_jj, shape (joints,), kg m^2.

        Infinite for a closed form, whose rotors are so heavy that its friction is never stiff.
        """
        return np.full_like(q, math.inf)
