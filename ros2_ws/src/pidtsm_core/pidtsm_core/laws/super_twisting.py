"""Inverse dynamics with super-twisting (Levant 1993) on a linear surface: a baseline."""

from pidtsm_core.laws.sliding_mode import compose

SUPER_TWISTING = compose(
    "super_twisting",
    "inverse dynamics with implicit super-twisting on a linear surface",
    surface="linear",
    manifold="none",
    reaching="super_twisting",
)
