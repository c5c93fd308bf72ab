"""Decides by their stamps which messages to use, by the same rule in every node."""

from enum import Enum
from typing import NamedTuple

from pidtsm_core.timing import NANOSECONDS, track_period


class Stamp(Enum):
    """Stamp of a message, compared with earlier ones."""

    NEW = "new"
    REPEATED = "the stamp equals that of the previous message"
    LATE = "the stamp is older than that of an earlier message"
    AHEAD = "the stamp is ahead of the source's clock"
    RESTARTED = "the source's clock was set, or the source restarted"

    @property
    def usable(self) -> bool:
        """Whether the message should be used."""
        return self in (Stamp.NEW, Stamp.RESTARTED)

    @property
    def explanation(self) -> str:
        """Why the message is not used, for the log."""
        return f"{self.name.lower()}: {self.value}"


class _Row(NamedTuple):
    """Increasing stamps of consecutive messages that were late or ahead, ns."""

    first: int = 0
    last: int = 0
    length: int = 0
    began: int = 0
    """Arrival time of the first, receiver's clock, ns."""

    def then(self, stamp: int, now: int | None) -> "_Row":
        """The row with one more stamp; in lockstep (`now` is None) a repeated stamp counts too."""
        if self.length and (stamp > self.last or (now is None and stamp == self.last)):
            return _Row(self.first, stamp, self.length + 1, self.began)
        return _Row(stamp, stamp, 1, now or 0)


_NO_ROW = _Row()


class _RecentLeads:
    """The largest lead of the last one to two seconds, or of at least the last ten messages.

    One late message, or a burst of them, therefore never lowers it. That of a source whose time is slower than the
    receiver's clock follows it down after two seconds.
    """

    LASTS, FEWEST = NANOSECONDS, 10
    """Shortest time (ns) and fewest messages after which older leads are dropped in one go."""

    def __init__(self, lead: int, now: int) -> None:
        self.largest = lead
        self._newer = lead  # largest since `_began`; that of the time before is in `largest` as well
        self._began, self._count = now, 1

    def add(self, lead: int, now: int) -> None:
        """Add the lead of a message that arrived at `now`."""
        if now - self._began >= self.LASTS and self._count >= self.FEWEST:
            self.largest, self._newer = self._newer, lead
            self._began, self._count = now, 0
        self._count += 1
        self._newer = max(self._newer, lead)
        self.largest = max(self.largest, lead)


class Arrivals:
    """Judges the stamps of messages from one source in the order of arrival.

    A stamp that goes back is late. A stamp that is ahead of the source's clock, as estimated from the receiver's clock,
    is ahead. Such messages should not be used. But several of them in a row, in increasing order and without a message
    of the old time in between, show that the source's clock was set or the source restarted. A single such stamp, or a
    few, never cause a restart.

    The source's clock may differ from the receiver's: only the progress of the two is compared.

    Attributes:
        last: stamp of the newest message used, ns; negative: none so far.
        elapsed: time between the last message used before the source's clock was set and the first one after, ns; 0:
            unknown.
        silence: longest time without any message between the last two messages used, receiver's clock, ns; 0 in
            lockstep.
        period: nominal time between two messages, ns; 0: not known yet.
        refused: number of messages that were late or ahead.
    """

    CONFIRMED, CONFIRMED_IN_LOCKSTEP = 5, 2
    """Consecutive messages that confirm a restart."""
    TOLERANCE = NANOSECONDS // 200
    """Largest lead of a stamp, and shortest duration of a restart, ns; or one period if that is longer."""
    _STALL = NANOSECONDS // 10
    """If the time between two messages is longer, the receiver was suspended, ns."""

    def __init__(self) -> None:
        self.refused = 0
        self.forget()

    @property
    def lead(self) -> int:
        """Stamp minus arrival time of the messages with the shortest delay, ns."""
        return self._leads.largest

    def forget(self) -> None:
        """Treat the next message as the first."""
        self.last = -1
        self.elapsed = self.silence = self.period = self._taken = 0
        self._received = self._silence = 0
        self._leads = _RecentLeads(0, 0)
        self._tolerance = self.TOLERANCE
        self._row = _NO_ROW

    def judge(self, stamp: int, now: int | None) -> Stamp:
        """Judge the stamp of a message; call `take` if the message is used.

        Args:
            stamp: stamp of the message, ns.
            now: monotonic clock of the receiver, ns; None in lockstep, where stamps are simulated time. There, no stamp
                is ahead, and repeated stamps count towards a restart, because the sender repeats unanswered messages.
        """
        if now is not None:
            self._silence = max(self._silence, now - self._received)
            self._received = now
        if self.last < 0:
            return Stamp.NEW
        if stamp == self.last:
            return Stamp.REPEATED
        # The tolerance comes first since it nearly always holds. The second message defines the period of the source.
        since = stamp - self.last
        if since > 0 and (
            now is None
            or since <= self._tolerance
            or self.period == 0
            or stamp - now <= self._leads.largest + self._tolerance
        ):
            return Stamp.NEW
        self._row = self._row.then(stamp, now)
        if self._is_confirmed(now is None):
            return Stamp.RESTARTED
        self.refused += 1
        return Stamp.LATE if stamp < self.last else Stamp.AHEAD

    def take(self, judged: Stamp, stamp: int, now: int | None) -> None:
        """Record that a message was used.

        Args:
            judged: result of `judge` for it.
            stamp: as for `judge`.
            now: as for `judge`.
        """
        if judged is Stamp.REPEATED:
            return
        follows = judged is Stamp.NEW and self.last >= 0
        if now is not None:
            self._compare_clocks(judged, stamp, now, follows)
        if follows:
            self.period = track_period(self.period, stamp - self.last)
            self._tolerance = max(self.TOLERANCE, self.period)
        self.last = stamp
        self._row = _NO_ROW

    def _compare_clocks(self, judged: Stamp, stamp: int, now: int, follows: bool) -> None:
        if follows:
            self._leads.add(stamp - now, now)
        else:
            self._leads = _RecentLeads(stamp - now, now)
        if judged is Stamp.RESTARTED:
            # The source's time from its first new message on; before that the receiver's, if the source was silent.
            silence = self._row.began - self._taken
            self.elapsed = stamp - self._row.first + (silence if silence > self._STALL else self.period)
        self.silence = self._silence if self.last >= 0 else 0
        self._silence = 0
        self._taken = now

    def age(self, now: int, system_time: int) -> int:
        """Age of the message used last, according to its stamp, ns.

        Args:
            now: as for `judge`.
            system_time: ns. If no message was ever younger than half a second, or one was from the future, the stamps
                are of another clock; the message with the shortest delay then counts as age 0.
        """
        youngest = system_time - now - self.lead
        return system_time - self.last if 0 <= youngest < NANOSECONDS // 2 else self.lead - (self.last - now)

    def _is_confirmed(self, lockstep: bool) -> bool:
        if lockstep:
            return self._row.length >= self.CONFIRMED_IN_LOCKSTEP
        return self._row.length >= self.CONFIRMED and self._row.last - self._row.first >= self._tolerance
