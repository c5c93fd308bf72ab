"""Which changes of the brakes are logged: they may open and close a thousand times per second."""

import time

CALM = 1.0
"""After this time without a change, the next change is logged again, s; frequent changes are not."""


class BrakeLog:
    """Follows the brakes of a simulated arm.

    Attributes:
        engaged: whether they are engaged now.
        count: how often they were engaged.
    """

    def __init__(self) -> None:
        self.engaged = False
        self.count = 0
        self._logged = False
        self._changed = 0.0

    def changes(self, engaged: bool) -> bool:
        """Take the state of the brakes at this sample; whether to log it."""
        if engaged == self.engaged == self._logged:
            return False
        now = time.monotonic()
        calm = now - self._changed > CALM
        if engaged != self.engaged:
            self.engaged, self._changed = engaged, now
            self.count += engaged
        if not calm or engaged == self._logged:
            return False
        self._logged = engaged
        return True
