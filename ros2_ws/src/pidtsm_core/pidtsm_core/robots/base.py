"""What a robot model provides."""

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
        joints: default names of its joints; their number is the number of joints.
        effort_limit: default torque limits, N m, one a joint.
        initial_position: default start, rad, one a joint.
        quantities: the parameters that are a ``mass``, an ``inertia`` or a ``length``, by these words.
        inverse_dynamics: compiled ``(q, dq, ddq, p, effort)``; ddq has shape (n, joints), one motion from q, dq a row,
            and row i of effort, N m, becomes that of row i.
        forward_dynamics: compiled ``(q, dq, effort, p, ddq)``; writes ddq in rad/s^2, shape (joints,).
        energy: compiled ``(q, dq, p)``; kinetic plus potential energy in J.
        add_payload: compiled ``(p, mass, loaded)``; writes the parameters with `mass` kg more at the last link's end.
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

        A parameter with choices is packed as the place of the choice.

        Args:
            values: by full name.
            group: of the parameters.
            factors: by quantity (see `quantities`); its parameters are multiplied by it.
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
