"""The article's proposed law: PID-type nonsingular dual terminal sliding mode, eqs. (10)-(30)."""

from pidtsm_core.laws.sliding_mode import compose

PIDDTSM = compose(
    "piddtsm",
    "adaptive PID nonsingular dual terminal sliding mode, the article's proposal, eqs. (10)-(30)",
    surface="dual_terminal",
    manifold="pid",
    reaching="adaptive_continuous",
)
