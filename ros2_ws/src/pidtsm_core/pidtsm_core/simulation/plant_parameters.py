"""Parameters of the simulated arm that depend on no robot: rate, payload, pushes and model errors."""

from collections.abc import Mapping

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value
from pidtsm_core.robots import Robot

QUANTITIES = ("mass", "inertia", "length")
"""Quantities with a possible model error, see `Robot.quantities`."""

RATE = Parameter("rate", 1000, "samples per second", "Hz", minimum=1, maximum=100_000, read_only=True)
PAYLOAD = "mass picked up at payload.time (Case 2: 0.5)"
LOADS = (
    Parameter("payload.time", 0.0, "time from the start at which the payload is picked up", "s", minimum=0.0),
    Parameter(
        "payload.duration", 0.0, "time from picking up the payload to dropping it; 0: never dropped", "s", minimum=0.0
    ),
    Parameter("push.effort", 0.0, "torque of a push on the joints", "N m", per_joint=True),
    Parameter(
        "push.force",
        (0.0, 0.0, 0.0),
        "force of a push on the tool, in the axes of the base: x, y, z",
        "N",
        length=3,
    ),
    Parameter(
        "push.torque",
        (0.0, 0.0, 0.0),
        "torque of a push on the tool, in the axes of the base: x, y, z",
        "N m",
        length=3,
    ),
    Parameter("push.time", 0.0, "time from the start at which the push begins", "s", minimum=0.0),
    Parameter("push.duration", 0.0, "duration of the push; 0: no push", "s", minimum=0.0),
)
MODEL_ERRORS = tuple(
    Parameter(
        f"model_error.{quantity}",
        0.0,
        f"relative deviation of each {quantity} of the simulated arm from robot.*; 0.25: 25 % more",
        minimum=-1.0,
        exclusive=True,
    )
    for quantity in QUANTITIES
)


def wrench_of(robot: Robot, values: Mapping[str, Value]) -> Array:
    """The wrench of a push on the tool, shape (6,).

    Raises:
        ParameterError: it is not known where the tool is.
    """
    wrench = np.hstack([np.asarray(values[name], dtype=np.float64) for name in ("push.force", "push.torque")])
    if wrench.any() and robot.tool is None:
        raise ParameterError(f"push.force: {robot.name} is a closed form without a tool; use push.effort", "push.force")
    return wrench
