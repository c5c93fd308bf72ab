"""Parameters of the barrier before the limits of the motion."""

from pidtsm_core.parameters import Parameter

BARRIER = (
    Parameter(
        "barrier.margin",
        0.0,
        "how far before limits.min_position and limits.max_position a joint is kept by a barrier, which also keeps "
        "limits.velocity: neither a reference nor a hand in freedrive gets past. A push moves a joint into the margin "
        "by its acceleration / (4 barrier.approach^2); 0: no barrier",
        "rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "barrier.approach",
        10.0,
        "largest velocity towards the barrier, per distance from it",
        "1/s",
        minimum=0.1,
        maximum=50.0,
    ),
)
