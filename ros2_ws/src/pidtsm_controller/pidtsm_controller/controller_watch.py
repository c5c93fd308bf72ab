"""Whether the controller follows references."""

from pidtsm_core.control.report import cause
from pidtsm_core.signals import Mode
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.wire import deserialize

_PERIOD = 10_000_000
"""ns; messages that come sooner are not read, because it takes as long as a tick."""


class ControllerWatch:
    """Reads the controller's mode.

    Attributes:
        trouble: why the controller follows no reference; empty if it does, or if nothing is known.
    """

    def __init__(self) -> None:
        self.trouble = ""
        self._last = 0

    def receive(self, data: bytes) -> None:
        """Take a serialized ControllerState.

        Raises:
            MessageError: it is none.
        """
        stamp = serialized_nanoseconds(data)
        if 0 < stamp - self._last < _PERIOD:
            return
        self._last = stamp
        state = deserialize(data, ControllerState)
        self.trouble = ""
        if state.mode == Mode.STOPPED:
            reason = cause(state.fault, state.fault_joint, state.name)
            self.trouble = f"the controller has stopped: {reason}; call its ~/reset_fault"
        elif state.mode == Mode.FREEDRIVE:
            self.trouble = "a person moves the arm by hand; call ~/freedrive of the controller to end that"
