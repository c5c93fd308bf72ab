"""What the parts of a page share: where they are shown, what they act on, and how an action is run."""

import asyncio
import traceback
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from viser import ClientHandle, GuiButtonHandle, GuiEvent, ViserServer

from pidtsm_experiments.live.changes import Changes
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
        changes: of parameters, so far.
        changing: held while parameters change, so what is undone is what was done last.
        occupied: what the controller has to stay away for; empty: nothing.
        offered: files that a browser may get, by their paths below the address of the page.
    """

    server: ViserServer
    system: System
    nodes: Nodes | None
    folder: Path
    scenario: str
    loop: asyncio.AbstractEventLoop
    changes: Changes = field(default_factory=Changes)
    changing: asyncio.Lock = field(default_factory=asyncio.Lock)
    occupied: str = ""
    offered: dict[str, Path] = field(default_factory=dict)

    def require_free(self) -> None:
        """Refuse what starts a controller while it has to stay away.

        Raises:
            RefusedError: it has to.
        """
        if self.occupied:
            raise RefusedError(f"{self.occupied}; release it first")

    def run(self, action: Coroutine[Any, Any, None]) -> None:
        """Run an action in the thread of the page; if it is refused, every browser shows why."""
        asyncio.run_coroutine_threadsafe(self._guarded(action), self.loop)

    async def _guarded(self, action: Coroutine[Any, Any, None]) -> None:
        try:
            await action
        except RefusedError as error:
            self.system.note(f"refused: {error}")
            self.notify("Refused", str(error), "red")
        except Exception as error:  # Whatever a browser sends, the page goes on.
            self.system.note(f"failed: {error!r}")
            traceback.print_exc()

    def notify(self, title: str, text: str, color: Any = "green") -> None:
        """Show a notification in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title, text, color=color, auto_close_seconds=_CLOSES_AFTER)

    def button(
        self,
        label: str,
        action: Callable[[], Coroutine[Any, Any, None]],
        hint: str,
        moves: bool = False,
        question: str = "",
        **looks: Any,
    ) -> GuiButtonHandle:
        """Add a button.

        Args:
            label: its text.
            action: what it does.
            hint: shown when the mouse is over it.
            moves: whether it may set the arm in motion, which must be confirmed if the arm is real.
            question: what is confirmed, as Markdown; empty: that everybody is out of its reach.
            looks: see `GuiApi.add_button`.
        """
        button = self.server.gui.add_button(label, hint=hint, **looks)

        @button.on_click
        def _(event: GuiEvent[Any]) -> None:
            self.act(event.client, str(button.label), action, moves, question)

        return button

    def act(
        self,
        client: ClientHandle | None,
        label: str,
        action: Callable[[], Coroutine[Any, Any, None]],
        moves: bool,
        question: str = "",
    ) -> None:
        """Run an action that a browser wants.

        Args:
            client: the browser.
            label: what it is called.
            action: what is to be done.
            moves: whether it may set the arm in motion, which must be confirmed if the arm is real.
            question: what is confirmed, as Markdown; empty: that everybody is out of its reach.
        """
        if moves and not self.system.simulated:
            asked = question or f"**{label}** may set it in motion. Is everybody out of its reach?"
            self.confirm(client, asked, label, action)
        else:
            self.run(action())

    def confirm(
        self, client: ClientHandle | None, question: str, label: str, action: Callable[[], Coroutine[Any, Any, None]]
    ) -> None:
        """Do something to a real arm, once it is confirmed.

        Args:
            client: the browser where it was wanted, which shows the question; None: it is not known, and all do.
            question: as Markdown.
            label: of the button that confirms.
            action: what is to be done.
        """
        gui = self.server.gui if client is None else client.gui
        with gui.add_modal("This is a real arm") as modal:
            gui.add_markdown(question)
            yes = gui.add_button(label, color="red")
            no = gui.add_button("Cancel")

        @yes.on_click
        def _(_event: GuiEvent[Any]) -> None:
            modal.close()
            self.run(action())

        @no.on_click
        def _(_event: GuiEvent[Any]) -> None:
            modal.close()
