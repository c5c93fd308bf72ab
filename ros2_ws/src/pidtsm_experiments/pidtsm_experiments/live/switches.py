"""Switches of the controller: freedrive, and hold."""

import time
from typing import Any

from viser import GuiCheckboxHandle, GuiEvent

from pidtsm_core.signals import Mode
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_msgs.msg import ControllerState

_HINTS = {
    "freedrive": "on: a person moves the arm by hand; off: the arm is held where it is (~/freedrive)",
    "hold": "on: the arm comes to rest and is held; off: it follows the reference again (~/hold)",
}
_MOVING = {("freedrive", True), ("hold", False)}
"""What may set the arm in motion."""
_SHOWN_AFTER = 1.5
"""s after which a switch shows what the controller does: it reports once a second that it holds on request."""


class Switches:
    """They show what the controller does, whoever has switched it."""

    def __init__(self, desk: Desk) -> None:
        """Add them to the current container."""
        self._desk = desk
        self._boxes = {name: self._box(name) for name in _HINTS}
        self._requested = dict.fromkeys(_HINTS, 0.0)

    def _box(self, name: str) -> GuiCheckboxHandle:
        box = self._desk.server.gui.add_checkbox(name, False, hint=_HINTS[name])

        @box.on_update
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:  # Otherwise it only shows what is.
                on = bool(box.value)
                self._requested[name] = time.monotonic() + _SHOWN_AFTER
                text = f"{name} {'on' if on else 'off'}"
                self._desk.act(event.client, text, lambda: self._switch(name, on), (name, on) in _MOVING)

        return box

    async def _switch(self, name: str, on: bool) -> None:
        try:
            await self._desk.system.switch(f"controller/{name}", on)
        except RefusedError:
            self._requested[name] = 0.0
            raise
        self._desk.system.note(f"{name} {'on' if on else 'off'}")

    def show(self, newest: ControllerState | None) -> None:
        """Show what the controller does; `newest`: its last state, or None."""
        if newest is None:
            return
        held = self._desk.system.held if newest.mode == Mode.HOLDING else False
        known = {"freedrive": newest.mode == Mode.FREEDRIVE, "hold": held}
        for name, on in known.items():
            box = self._boxes[name]
            if on is not None and time.monotonic() > self._requested[name] and box.value != on:
                setattr(box, "value", on)  # noqa: B010  viser's types do not know that it can be set.
