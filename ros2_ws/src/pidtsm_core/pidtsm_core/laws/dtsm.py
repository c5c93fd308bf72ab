"""Dual terminal sliding mode (Ma and Sun 2018, the article's reference 10)."""

from pidtsm_core.laws.sliding_mode import compose

DTSM = compose(
    "dtsm",
    "dual terminal sliding mode, a comparator of the article (its reference [10])",
    surface="dual_terminal",
    manifold="none",
    reaching="adaptive_continuous",
    # With kappa = 0.01, the value in Table 1, the loop diverges.
    defaults={"kappa": 0.3},
)
