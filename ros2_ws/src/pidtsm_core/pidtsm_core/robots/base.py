"""Interface of a robot model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array, Value, as_float

Dynamics = Callable[[Array, Array, Array, Array, Array], None]


@dataclass(frozen=True)
class Robot(Member):
    """A rigid manipulator, eq. (1): H(q) q'' + C(q, q') q' + G(q) = effort.

    Attributes:
        joints: default names of its joints; they also define the number of joints.
        effort_limit: default torque limits, N m, one per joint.
        initial_position: default start position, rad, one value per joint.
        quantities: names of the parameters that are masses, inertias or lengths; the keys are ``mass``, ``inertia``
            and ``length``.
        inverse_dynamics: compiled ``(q, dq, ddq, p, effort)``; ddq has shape (n, joints), one acceleration per row;
            writes the effort (N m) that causes row i at q, dq to row i of effort.
        forward_dynamics: compiled ``(q, dq, effort, p, ddq)``; writes ddq in rad/s^2, shape (joints,).
        energy: compiled ``(q, dq, p)``; kinetic plus potential energy in J.
        add_payload: compiled ``(p, mass, loaded)``; writes the parameters with `mass` kg added at the last link's end.
    """

    joints: tuple[str, ...]
    effort_limit: tuple[float, ...]
    initial_position: tuple[float, ...]
    quantities: Mapping[str, tuple[str, ...]]
    inverse_dynamics: Dynamics
    forward_dynamics: Dynamics
    energy: Callable[[Array, Array, Array], float]
    add_payload: Callable[[Array, float, Array], None]

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
                packed.append(float(parameter.choices.index(str(value))))
            else:
                packed.append(as_float(value) * factor.get(parameter.name, 1.0))
        return np.array(packed)
