"""Which of the stamped messages that arrive are to be used: one rule for every node."""

from enum import Enum
from typing import NamedTuple

from pidtsm_core.timing import NANOSECONDS, track_period


class Stamp(Enum):
    """What the stamp of a message says, beside those that came before."""

    NEW = "new"
    REPEATED = "it is that of the message before"
    LATE = "it is older than that of a message received before"
    AHEAD = "it is ahead of its source's clock so far"
    RESTARTED = "it continues others that were late or ahead: the clock of its source has been set"

    @property
    def usable(self) -> bool:
        """The message is to be used."""
        return self in (Stamp.NEW, Stamp.RESTARTED)

    @property
    def explanation(self) -> str:
        """For the log, why the message is not used."""
        return f"{self.name.lower()}: {self.value}"


class _Row(NamedTuple):
    """Stamps in order, ns, of messages that were late or ahead, with none between them that was used."""

    first: int = 0
    last: int = 0
    length: int = 0
    began: int = 0
    """When the first arrived, by one's own clock, ns."""

    def then(self, stamp: int, now: int | None) -> "_Row":
        """With one more; in lockstep (`now` is None) the same stamp again counts."""
        if self.length and (stamp > self.last or (now is None and stamp == self.last)):
            return _Row(self.first, stamp, self.length + 1, self.began)
        return _Row(stamp, stamp, 1, now or 0)


_NO_ROW = _Row()


class Arrivals:
    """Judges the stamps of one source's messages in the order in which they arrive.

    A stamp that goes back is late, and one that runs ahead of the source's clock, as it compares with one's own, is
    ahead: such messages are not to be used. But several of them in a row, in order, and with none of the time before
    in between, show that the clock of the source has been set, or the source been started anew. So one stamp, or a few,
    never restart anything.

    The source's clock need not be one's own: only how the two have gone on since counts.

    Attributes:
        last: stamp of the newest message used, ns; negative: there was none.
        elapsed: ns between the last message used before the source's clock was set and the first one after; 0: not
            known.
        period: nominal time between two messages, ns; 0: not known so far.
        refused: messages that were late or ahead.
    """

    CONFIRMED, CONFIRMED_IN_LOCKSTEP = 5, 2
    """Messages in a row that make a restart."""
    TOLERANCE = NANOSECONDS // 200
    """ns that a stamp may be ahead, and that a restart must last; or a period, where that is longer."""
    _DRIFT = 2000
    """Clocks differ by less than one part in so many."""
    _STALL = NANOSECONDS // 10
    """ns between two messages; with more the receiver has not run."""

    def __init__(self) -> None:
        self.refused = 0
        self.forget()

    def forget(self) -> None:
        """Take whatever comes next for the first message."""
        self.last = -1
        self.elapsed = self.period = self._taken = self._lead = 0
        self._tolerance = self.TOLERANCE
        self._row = _NO_ROW

    def judge(self, stamp: int, now: int | None) -> Stamp:
        """What the stamp (ns) of a message says; if the message is used, `take` is to be called.

        Args:
            stamp: of the message.
            now: one's own clock, ns, that never goes back; None in lockstep, where simulated time has nothing to do
                with it. Nothing is ahead there, and a stamp that is sent again counts: somebody waits for an answer.
        """
        if self.last < 0:
            return Stamp.NEW
        if stamp == self.last:
            return Stamp.REPEATED
        # The tolerance first: it holds nearly always. And the second message tells how fast time goes there.
        since = stamp - self.last
        if since > 0 and (
            now is None or since <= self._tolerance or self.period == 0 or stamp - now <= self._lead + self._tolerance
        ):
            return Stamp.NEW
        self._row = self._row.then(stamp, now)
        if self._is_confirmed(now is None):
            return Stamp.RESTARTED
        self.refused += 1
        return Stamp.LATE if stamp < self.last else Stamp.AHEAD

    def take(self, judged: Stamp, stamp: int, now: int | None) -> None:
        """Use the message that was judged so."""
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
        lead, since = stamp - now, now - self._taken
        if not follows or lead >= self._lead:
            self._lead = lead
        else:
            # Simulated time may be slower than one's own; but where one has not run, it is not.
            slower = (self._lead - lead) * since // NANOSECONDS if since < self._STALL else 0
            self._lead = max(lead, self._lead - slower - since // self._DRIFT)
        if judged is Stamp.RESTARTED:
            # The source's own time from its first message on; one's own only before, where it may have been silent.
            silence = self._row.began - self._taken
            self.elapsed = stamp - self._row.first + (silence if silence > self._STALL else self.period)
        self._taken = now

    def age(self, now: int, system_time: int) -> int:
        """How old the message used last is, ns, going by its stamp.

        Args:
            now: as for `judge`.
            system_time: ns. Where no message was ever younger than half a second, or one came from the future, the
                stamps are of another clock; the message that came soonest after its stamp then counts as new.
        """
        youngest = system_time - now - self._lead
        return system_time - self.last if 0 <= youngest < NANOSECONDS // 2 else self._lead - (self.last - now)

    def _is_confirmed(self, lockstep: bool) -> bool:
        if lockstep:
            return self._row.length >= self.CONFIRMED_IN_LOCKSTEP
        return self._row.length >= self.CONFIRMED and self._row.last - self._row.first >= self._tolerance
