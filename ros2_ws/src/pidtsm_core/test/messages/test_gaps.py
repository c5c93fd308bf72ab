"""After a gap of any length, in the stamps, on the node's own clock, or both, nothing moves by itself."""

import numpy as np
import pytest

from pidtsm_core.messages.arrivals import Arrivals, Stamp
from pidtsm_core.messages.gaps import Continuation, continuation

MS = 1_000_000
SECOND = 1000 * MS
LONGEST = 20 * MS
GAPS = [MS, 5 * MS, 19 * MS, 20 * MS, 21 * MS, 100 * MS, 500 * MS, SECOND, 5 * SECOND, 60 * SECOND, 3600 * SECOND]
WAITING = [0, 1, 100, 400, 10**9]
"""Joint states of the gap that are still delivered."""


class Node:
    """A node at 1 kHz and what it decides; times in ns."""

    def __init__(self) -> None:
        self.arrivals = Arrivals()
        self.decided: list[Continuation] = []

    def receive(self, stamp: int, now: int) -> None:
        last, judged = self.arrivals.last, self.arrivals.judge(stamp, now)
        if judged.usable:
            self.arrivals.take(judged, stamp, now)
            self.decided.append(continuation(judged, stamp - last if last >= 0 else 0, self.arrivals.silence, LONGEST))

    def go_on(self, stamp: int, now: int, messages: int = 500) -> tuple[int, int]:
        for _ in range(messages):
            stamp, now = stamp + MS, now + MS
            self.receive(stamp, now)
        return stamp, now


@pytest.mark.parametrize("by_stamps", GAPS)
def test_a_gap_by_either_clock_stops_the_arm(by_stamps: int) -> None:
    """Also where stamps and clock do not agree: the source or the node was suspended, or a clock was set."""
    for by_own_clock in GAPS:
        node = Node()
        stamp, now = node.go_on(SECOND, SECOND)
        node.decided.clear()
        node.receive(stamp + by_stamps, now + by_own_clock)
        node.go_on(stamp + by_stamps, now + by_own_clock, 10)
        if by_own_clock > LONGEST:
            expected = Continuation.STOP
        elif by_stamps - by_own_clock > Arrivals.TOLERANCE:
            expected = Continuation.HOLD  # The node has received from the source all the time.
        else:
            expected = Continuation.STOP if by_stamps > LONGEST else Continuation.FOLLOW
        found = set(node.decided) - {Continuation.FOLLOW}
        assert found == ({expected} - {Continuation.FOLLOW}), by_own_clock


@pytest.mark.parametrize("gap", [gap for gap in GAPS if gap <= 60 * SECOND])
@pytest.mark.parametrize("oldest", [True, False], ids=["the oldest kept", "the newest kept"])
def test_a_suspended_node_stops_the_arm_whatever_has_waited_for_it(gap: int, oldest: bool) -> None:
    """The joint states of the gap that were not lost arrive together."""
    for waiting in WAITING:
        node = Node()
        stamp, now = node.go_on(SECOND, SECOND)
        node.decided.clear()
        during = np.arange(MS, gap, MS)
        kept = during[:waiting] if oldest else during[max(during.size - waiting, 0) :]
        for n, sent in enumerate(kept.tolist()):
            node.receive(stamp + sent, now + gap + 1000 * n)
        node.go_on(stamp + gap, now + gap + 1000 * kept.size)
        stops = Continuation.STOP in node.decided
        assert stops == (gap + MS > LONGEST if not kept.size else gap > LONGEST), waiting
        assert Continuation.HOLD not in node.decided, f"no clock was set: {waiting}"


@pytest.mark.parametrize("set_by", [s * gap for gap in GAPS if gap > LONGEST for s in (-1, 1)])
def test_only_a_new_clock_holds_the_arm(set_by: int) -> None:
    node = Node()
    stamp, now = node.go_on(10_000 * SECOND, SECOND)
    node.decided.clear()
    node.go_on(stamp + set_by, now)
    assert node.decided.count(Continuation.HOLD) == 1
    assert Continuation.STOP not in node.decided


def test_a_new_clock_after_a_silence_stops_the_arm() -> None:
    assert continuation(Stamp.RESTARTED, 0, LONGEST + 1, LONGEST) is Continuation.STOP
    assert continuation(Stamp.RESTARTED, 10**12, LONGEST, LONGEST) is Continuation.HOLD
