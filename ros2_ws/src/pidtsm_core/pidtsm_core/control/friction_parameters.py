"""Parameters of the friction that the controller compensates."""

from pidtsm_core.parameters import Parameter

BREAKAWAY = Parameter(
    "compensation.breakaway",
    True,
    "where friction is compensated, joints leave rest with what was found in motion, not with what has wound up",
)
FRICTION = (
    Parameter(
        "compensation.coulomb",
        0.0,
        "Coulomb friction that the controller compensates, in the direction of the reference",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "compensation.viscous",
        0.0,
        "viscous friction that the controller compensates, at the velocity of the reference",
        "N m s/rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "compensation.offset",
        0.0,
        "constant effort that the joint needs beside its model and friction, such as that of a counterbalance",
        "N m",
        per_joint=True,
    ),
    Parameter(
        "compensation.error_gain",
        0.0,
        "Coulomb friction is compensated for the velocity of the reference less this times the error, so that a joint "
        "that sticks is pressed back; without effect where limits.effort_rate limits",
        "1/s",
        minimum=0.0,
        per_joint=True,
    ),
)
