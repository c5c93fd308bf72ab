"""The parameters of one node on the page: a form for each group."""

from collections.abc import Mapping, Sequence
from typing import Any

from viser import GuiTabHandle

from pidtsm_experiments.live.controls import Form, Message, groups
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.parameters import Described

SHOWN = {
    "controller": (
        "law",
        "estimator",
        "compensation",
        "payload",
        "limits",
        "activation",
        "watchdog",
        "plausibility",
        "stop",
    ),
    "simulator": (
        "encoder",
        "noise",
        "delay",
        "dropout",
        "friction",
        "backlash",
        "jitter",
        "actuator",
        "model_error",
        "disturbance",
    ),
    "trajectory": ("reference",),
}
"""By node, the groups of parameters that have a form, in this order."""
_OPEN = ("law", "estimator", "encoder", "noise", "delay", "reference")


class NodeForms:
    """The forms of one node, in a container of their own.

    A parameter that can only be set at the start is set by starting the node again; if the page cannot do that, it is
    not shown.

    Attributes:
        values: every parameter of the node, by name.
    """

    def __init__(self, desk: Desk, node: str, tab: GuiTabHandle) -> None:
        """Reserve the place in a tab; see `build`."""
        self.values: dict[str, Any] = {}
        self._desk, self._node = desk, node
        self._tab = tab
        with tab:
            self._message = Message(desk.server.gui)
            self._folder = desk.server.gui.add_folder(None)
        self._forms: list[Form] = []
        self._fixed: set[str] = set()

    async def build(self) -> None:
        """Read the parameters of the node, and make the forms anew.

        Raises:
            RefusedError: see `System.described`.
        """
        described = await self._desk.system.described(self._node)
        self.values = {each.name: each.value for each in described}
        self._fixed = {each.name for each in described if each.descriptor.read_only}
        by_group, gui, place = groups(self._settable(described)), self._desk.server.gui, self._folder.order
        self._folder.remove()
        with self._tab:
            self._folder = gui.add_folder(None, order=place)
        with self._folder:
            self._forms = [
                Form(gui, group, by_group[group], self._apply, self._desk.run, self._message, group in _OPEN)
                for group in SHOWN[self._node]
                if group in by_group
            ]

    def _settable(self, described: Sequence[Described]) -> list[Described]:
        """Those that the page can set, choices first."""
        able = [each for each in described if self._desk.nodes is not None or not each.descriptor.read_only]
        return sorted(able, key=lambda each: (not each.name.endswith(".name"), each.name in self._fixed))

    async def _apply(self, changes: Mapping[str, Any]) -> None:
        """Set parameters of the running node, or start it again with them."""
        if self._fixed.isdisjoint(changes):
            await self._desk.system.set(self._node, changes)
        elif self._desk.nodes is not None:
            await self.restart(changes)

    async def restart(self, changes: Mapping[str, Any] | None = None) -> None:
        """Start the node again with changed parameters, and read them.

        Raises:
            RefusedError: see `Nodes.restart`; or the node does not come back.
        """
        nodes = self._desk.nodes
        if nodes is None:
            raise RefusedError(f"{self._node} was not started by this page")
        await nodes.restart(self._node, changes)
        while True:
            try:
                await self.build()
                break
            except RefusedError:
                if ended := nodes.ended(self._node):
                    raise RefusedError(
                        f"{self._node} {ended}; its last lines:\n{nodes.last_words(self._node)}"
                    ) from None
        self._desk.system.note(f"{self._node} started again")

    def follow(self, changes: Mapping[str, Any]) -> None:
        """Show what somebody has changed; a new start of the node by the page uses it."""
        self.values.update(changes)
        for form in self._forms:
            form.show(changes)
        if self._desk.nodes is not None:
            self._desk.nodes.remember(self._node, changes)
