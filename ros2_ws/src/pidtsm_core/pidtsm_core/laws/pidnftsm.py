"""PID nonsingular fast terminal sliding mode (Van 2018, the article's reference 23)."""

from pidtsm_core.laws.sliding_mode import compose

PIDNFTSM = compose(
    "pidnftsm",
    "PID nonsingular fast terminal sliding mode, a comparator of the article (its reference [23]); singular at e' = 0",
    surface="fast_nonsingular",
    manifold="pid",
    reaching="adaptive_continuous",
)
