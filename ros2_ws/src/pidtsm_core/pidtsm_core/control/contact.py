"""What acts on the arm from outside: the effort of which neither the motors nor the model know.

It is the difference between the effort that the estimated motion needs and the one that was applied ("direct
estimation" in Haddadin, De Luca and Albu-Schaeffer, "Robot collisions: A survey", IEEE Transactions on Robotics 33(6),
2017). Payloads and model errors contribute to it, too, and the law learns them while the arm tracks. Contact is what
changes it by much and keeps the arm from tracking. So does friction, by twice its value, when a joint reverses; but it
only changes its sign.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, External, Time, part
from pidtsm_core.signals import Signal, Status, Violation

_MEAN = 0.05
"""s; averaging time."""


_TRACKED = 0.01
"""rad or m; what acts on an arm that is nearer to its reference does not hold it back."""


@part
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
        now = needed[j] - state.net[j]
        external[External.NOW, j] = now if math.isfinite(now) else 0.0
        external[External.ONCE, j] += share * (needed[j] - state.net[j] - external[External.ONCE, j])
        external[External.TWICE, j] += share * (external[External.ONCE, j] - external[External.TWICE, j])
        if not math.isfinite(external[External.TWICE, j]):
            external[External.ONCE, j] = external[External.TWICE, j] = 0.0
        if farthest < _TRACKED and state.times[Time.FREED] == 0:  # In freedrive, what is felt is a hand.
            external[External.USUAL, j] = external[External.TWICE, j]
            # A reference that has gone that far since its reversal has taken the joint along.
            ahead = state.desired[0, j] - external[External.BEHIND, j]
            if abs(ahead) >= _TRACKED:
                external[External.MOVING, j] = external[External.TWICE, j]
                external[External.DIRECTION, j] = math.copysign(1.0, ahead)
        behind = max(external[External.BEHIND, j], state.desired[0, j] - _TRACKED)
        external[External.BEHIND, j] = min(behind, state.desired[0, j] + _TRACKED)
        external[External.CHANGE, j] = external[External.TWICE, j] - _explained(state, j)


@inlined
def _explained(state: ControllerState, j: int) -> float:
    """The external effort of joint j, N m, that is nearest to the present one and no contact.

    It is the usual one, or after a reversal any up to what acted before with the other sign, as friction does.
    """
    external = state.external
    usual = external[External.USUAL, j]
    if external[External.DIRECTION, j] * state.desired[1, j] >= 0.0:
        return usual
    opposite = -external[External.MOVING, j]
    return min(max(external[External.TWICE, j], min(usual, opposite)), max(usual, opposite))


@inlined
def in_contact(config: ControllerConfig, state: ControllerState) -> bool:
    """Whether the arm touches something, so that the errors are not due to the model.

    A reference that yields is followed all the same.
    """
    return (
        config.freezes
        and not config.compliance.active
        and state.status[Status.VIOLATIONS] & Violation.EXTERNAL_EFFORT != 0
    )
