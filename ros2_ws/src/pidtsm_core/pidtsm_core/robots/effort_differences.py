"""How far the efforts of a closed form can be from those of one state, where it gives no bound itself."""

from collections.abc import Callable

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine

_SAFETY = 2.0


def spread_of_differences(
    inverse_dynamics: Callable[[Array, Array, Array, Array, Array], None],
) -> Callable[[Array, Array, Array, Array, Array, Array], None]:
    """A function as `Dynamics.effort_spread`: twice the sum of the changes from the middle of the box to its faces.

    All its arrays have the shape (joints,) or (3, joints).

    That is an estimate, as no bound follows from the efforts alone. It is exact where they change linearly, as they
    nearly do in a small box, and then twice what is needed.
    """

    @subroutine
    def spread_to_faces(q: Array, dq: Array, ddq: Array, box: Array, p: Array, spread: Array) -> None:
        joints = q.size
        row, efforts = ddq.reshape(1, joints), spread[1:2]
        for i in range(joints):
            spread[0, i] = 0.0
        for order in range(3):
            for j in range(joints):
                values = q if order == 0 else (dq if order == 1 else ddq)
                middle = values[j]
                for side in range(3):
                    values[j] = middle + (side - 1.0) * box[order, j]
                    inverse_dynamics(q, dq, row, p, efforts)
                    for i in range(joints):
                        if side == 0:
                            spread[2, i] = efforts[0, i]
                        else:
                            spread[0, i] += 0.5 * _SAFETY * abs(efforts[0, i] - spread[2, i])
                            spread[2, i] = efforts[0, i]
                values[j] = middle

    return spread_to_faces
