"""Decides how a controller goes on after a time without joint states: after a long one, nothing moves by itself."""

from enum import Enum

from pidtsm_core.messages.arrivals import Stamp


class Continuation(Enum):
    """How a controller goes on with a joint state."""

    FOLLOW = "as before"
    HOLD = "hold the arm until references of the new time arrive"
    STOP = "latch the fault STATE_STALE"


def continuation(judged: Stamp, by_stamps: int, by_own_clock: int, longest: int) -> Continuation:
    """How to go on with a usable joint state.

    A gap by either clock stops the arm: by the stamps, joint states were lost; by the node's own clock, the node did
    not run or received nothing, even if every joint state of that time has waited for it. Only while joint states keep
    arriving does a new time mean that their clock was set.

    Args:
        judged: result of `Arrivals.judge` for its stamp.
        by_stamps: time since the last joint state used, ns, by their stamps.
        by_own_clock: longest time without any joint state since then, ns, by the node's clock.
        longest: longest gap that is no fault, ns.
    """
    if by_own_clock > longest:
        return Continuation.STOP
    if judged is Stamp.RESTARTED:
        return Continuation.HOLD
    return Continuation.STOP if by_stamps > longest else Continuation.FOLLOW
