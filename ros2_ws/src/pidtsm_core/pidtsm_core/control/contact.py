"""What acts on the arm from outside: the effort of which neither the motors nor the model know.

It is the difference between the effort that the estimated motion needs and the one that was applied ("direct
estimation" in Haddadin, De Luca and Albu-Schaeffer, "Robot collisions: A survey", IEEE Transactions on Robotics 33(6),
2017). Payloads and model errors contribute to it, too, and the law learns them while the arm tracks. Contact is what
changes it by much and keeps the arm from tracking.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, External, Time
from pidtsm_core.signals import Signal, Status, Violation

_MEAN = 0.05
"""s; averaging time."""


_TRACKED = 0.01
"""rad or m; what acts on an arm that is nearer to its reference does not hold it back."""


@inlined
def sense_contact(state: ControllerState, needed: Array, dt: float) -> None:
    """Update ``state.external`` after dt (s).

    Args:
        state: state, which is changed; ``net`` is the effort applied since the last tick.
        needed: effort that the estimated motion needs, by the model, shape (joints,), N m.
        dt: s.
    """
    external, share, farthest = state.external, min(dt / _MEAN, 1.0), 0.0
    for j in range(needed.size):
        farthest = max(farthest, abs(state.signals[Signal.POSITION_ERROR, j]))
    for j in range(needed.size):
        external[External.ONCE, j] += share * (needed[j] - state.net[j] - external[External.ONCE, j])
        external[External.TWICE, j] += share * (external[External.ONCE, j] - external[External.TWICE, j])
        if not math.isfinite(external[External.TWICE, j]):
            external[External.ONCE, j] = external[External.TWICE, j] = 0.0
        if farthest < _TRACKED and state.times[Time.FREED] == 0:  # In freedrive, what is felt is a hand.
            external[External.USUAL, j] = external[External.TWICE, j]
        external[External.CHANGE, j] = external[External.TWICE, j] - external[External.USUAL, j]


@inlined
def in_contact(config: ControllerConfig, state: ControllerState) -> bool:
    """Whether the arm touches something, so that the errors are not due to the model."""
    return config.freezes and state.status[Status.VIOLATIONS] & Violation.EXTERNAL_EFFORT != 0
