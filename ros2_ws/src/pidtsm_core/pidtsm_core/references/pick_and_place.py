"""From one point to another and back, with a rest at each."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters import Parameter
from pidtsm_core.references.base import SHORTEST, Reference


@njit
def evaluate(t: float, p: Array, desired: Array) -> None:
    """The quintic of Flash and Hogan (1985), forth and back: q_d, and its derivatives."""
    for j in range(desired.shape[1]):
        begin, end, duration, rest = p[j, 0], p[j, 1], p[j, 2], p[j, 3]
        half = duration + rest
        legs = int(max(t, 0.0) // half)
        if legs % 2 == 1:
            begin, end = end, begin
        s = min(max(t - legs * half, 0.0) / duration, 1.0)
        way = end - begin
        desired[0, j] = begin + way * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        # At rest, the sum makes 0 of -0.
        desired[1, j] = way / duration * 30.0 * s * s * (1.0 - s) * (1.0 - s) + 0.0
        desired[2, j] = way / (duration * duration) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) + 0.0


PICK_AND_PLACE = Reference(
    name="pick_and_place",
    summary="from one point to another and back, for ever, with minimum jerk and a rest at each",
    parameters=(
        Parameter("from", 0.0, "position at the start", "rad", per_joint=True, read_only=True),
        Parameter("to", 0.5, "the other position", "rad", per_joint=True, read_only=True),
        Parameter(
            "duration",
            2.0,
            "time from one to the other",
            "s",
            minimum=SHORTEST,
            per_joint=True,
            read_only=True,
        ),
        Parameter("rest", 1.0, "time of a rest", "s", minimum=0.0, per_joint=True, read_only=True),
    ),
    joints=0,
    evaluate=evaluate,
)
