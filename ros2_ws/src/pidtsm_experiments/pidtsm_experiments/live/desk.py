"""What the parts of a page share: where they are shown, what they act on, and how an action is run."""

import asyncio
import traceback
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from viser import GuiEvent, ViserServer

from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.nodes import Nodes
from pidtsm_experiments.live.system import System

_CLOSES_AFTER = 8.0  # s


@dataclass
class Desk:
    """One page, which every browser shows alike.

    Attributes:
        server: of the page.
        system: the nodes.
        nodes: their processes, if the page has started them; None: somebody else has.
        folder: for what the page writes.
        scenario: name of the experiment, for reports.
        loop: of the thread of the page; everything that touches ROS or a process runs in it.
    """

    server: ViserServer
    system: System
    nodes: Nodes | None
    folder: Path
    scenario: str
    loop: asyncio.AbstractEventLoop

    def run(self, action: Coroutine[Any, Any, None]) -> None:
        """Run an action in the thread of the page; if it is refused, every browser shows why."""
        asyncio.run_coroutine_threadsafe(self._guarded(action), self.loop)

    async def _guarded(self, action: Coroutine[Any, Any, None]) -> None:
        try:
            await action
        except RefusedError as error:
            self.system.note(f"refused: {error}")
            self.tell("Refused", str(error), "red")
        except Exception as error:  # Whatever a browser sends, the page goes on.
            self.system.note(f"failed: {error!r}")
            traceback.print_exc()

    def tell(self, title: str, text: str, color: Any = "green") -> None:
        """Show a notification in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title, text, color=color, auto_close_seconds=_CLOSES_AFTER)

    def button(
        self, label: str, action: Callable[[], Coroutine[Any, Any, None]], hint: str, moves: bool = False, **looks: Any
    ) -> None:
        """Add a button.

        Args:
            label: its text.
            action: what it does.
            hint: shown when the mouse is over it.
            moves: whether it may set the arm in motion, which must be confirmed if the arm is real.
            looks: see `GuiApi.add_button`.
        """
        button = self.server.gui.add_button(label, hint=hint, **looks)

        @button.on_click
        def _(event: GuiEvent[Any]) -> None:
            if moves and not self.system.simulated and event.client is not None:
                self._confirm(event, label, action)
            else:
                self.run(action())

    def _confirm(self, event: GuiEvent[Any], label: str, action: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Show the question in the browser where the button was pressed."""
        assert event.client is not None
        gui = event.client.gui
        with gui.add_modal("This is a real arm") as modal:
            gui.add_markdown(f"**{label}** may set it in motion. Is everybody out of its reach?")
            yes = gui.add_button(label, color="red")
            no = gui.add_button("Cancel")

        @yes.on_click
        def _(_event: GuiEvent[Any]) -> None:
            modal.close()
            self.run(action())

        @no.on_click
        def _(_event: GuiEvent[Any]) -> None:
            modal.close()
