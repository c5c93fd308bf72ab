"""What several reaching laws use."""

from pidtsm_core.compiling.decorators import inlined


@inlined
def sign(x: float) -> float:
    """-1, 0 or 1, as in eq. (25)."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
