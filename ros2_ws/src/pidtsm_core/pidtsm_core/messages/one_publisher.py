"""Distinguishes the messages of one publisher of a topic from those of another, so that a node obeys only one."""

from collections.abc import Callable

from pidtsm_core.timing import NANOSECONDS


class OnePublisher:
    """Accepts the messages of the publisher that was there first.

    Middleware numbers the messages of each publisher, but does not name the publisher of a message. The messages of
    one have increasing numbers, without large gaps. Those of another begin at 1, or go on elsewhere. Another
    publisher is accepted when the first has been silent for `SILENCE` while the other published, or has gone.

    Attributes:
        refused: number of messages of other publishers.
    """

    SILENCE = NANOSECONDS // 10
    """ns."""
    _LOST, _BETWEEN = 10, 100_000
    """Messages that may be missing between two; and one more per so many ns between them."""

    def __init__(self) -> None:
        self.refused = 0
        self._last = self._other = -1
        self._received = self._challenged = 0

    def accepts(self, number: int, now: int, alone: Callable[[], bool]) -> bool:
        """Whether to read a message; then call `take` if its content is valid, too.

        Args:
            number: of the message, counted by the middleware for each publisher.
            now: monotonic clock of the receiver, ns.
            alone: returns whether the topic has only one publisher now.
        """
        if self._last < 0:
            return True
        missing = number - self._last - 1
        follows = missing == 0 or (
            number != self._other + 1 and 0 < missing <= self._LOST + (now - self._received) // self._BETWEEN
        )
        if follows:
            self.take(number, now)
            return True
        self._challenged = self._challenged or now
        if alone() or now - self._challenged > self.SILENCE:
            return True
        self._other = number
        self.refused += 1
        return False

    def take(self, number: int, now: int) -> None:
        """Obey the publisher of this message, which was valid."""
        if self._challenged and number == self._other + 1:
            self._other = -1  # It is the other that is obeyed now.
        self._last, self._received, self._challenged = number, now, 0
