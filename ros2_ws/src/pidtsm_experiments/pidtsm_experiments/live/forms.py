"""The parameters of one node on the page: a form for each group."""

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Any

from viser import ClientHandle, GuiTabHandle

from pidtsm_experiments.live.changes import LARGE, described, is_large
from pidtsm_experiments.live.controls import Acts, Form, Message, groups
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.lives import how_to_start
from pidtsm_experiments.live.nodes import Nodes
from pidtsm_experiments.live.parameters import Described
from pidtsm_experiments.runs.runner import EXECUTABLES

SHOWN = {
    "controller": (
        "law",
        "estimator",
        "compensation",
        "compliance",
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
        self._building = asyncio.Lock()
        self._reported: list[Mapping[str, Any]] = []
        """Changes that the node has reported while its parameters were being read: the answer may be older."""

    async def build(self) -> None:
        """Read the parameters of the node, and make the forms anew.

        Raises:
            RefusedError: see `System.described`.
        """
        await self._read()
        self._catch_up()

    async def _read(self) -> None:
        async with self._building:
            self._reported = []
            described = await self._desk.system.described(self._node)
            self.values = {each.name: each.value for each in described}
            self._fixed = {each.name for each in described if each.descriptor.read_only}
            by_group, gui, place = groups(self._settable(described)), self._desk.server.gui, self._folder.order
            self._folder.remove()
            with self._tab:
                self._folder = gui.add_folder(None, order=place)
            acts = Acts(self.apply, self._agree, self._desk.run)
            with self._folder:
                self._forms = [
                    Form(gui, group, by_group[group], acts, self._message, group in _OPEN)
                    for group in SHOWN[self._node]
                    if group in by_group
                ]

    def _catch_up(self) -> None:
        reported, self._reported = self._reported, []
        for changes in reported:
            self.follow(changes)

    def _settable(self, described: Sequence[Described]) -> list[Described]:
        """Those that the page can set, choices first."""
        able = [each for each in described if self._desk.nodes is not None or not each.descriptor.read_only]
        return sorted(able, key=lambda each: (not each.name.endswith(".name"), each.name in self._fixed))

    async def submit(self, client: ClientHandle | None, changes: Mapping[str, Any]) -> None:
        """`apply`, after a browser has confirmed a large change of a real arm.

        Raises:
            RefusedError: see `put`.
        """
        if not self._agree(client, changes, lambda: self.apply(changes)):
            await self.apply(changes)

    def _agree(
        self, client: ClientHandle | None, values: Mapping[str, Any], go_on: Callable[[], Coroutine[Any, Any, None]]
    ) -> bool:
        """Have a large change of a real arm confirmed; false: nothing needs a confirmation."""
        known = self.values
        large = [name for name, value in values.items() if is_large(known.get(name), value)]
        if not large or self._desk.system.simulated:
            return False
        before = {name: known.get(name) for name in values}

        async def confirmed() -> None:
            if before != {name: self.values.get(name) for name in values}:
                raise RefusedError(f"{', '.join(values)}: changed in the meantime; look, and apply it again")
            await go_on()

        lines = "\n".join(f"* {described(name, before[name], values[name])}" for name in large)
        question = f"A change by more than a factor of {LARGE:g}:\n\n{lines}\n\nIs everybody out of its reach?"
        self._desk.confirm(client, question, "Change it", confirmed)
        return True

    async def apply(self, changes: Mapping[str, Any]) -> None:
        """`put`, after what else is being changed.

        Raises:
            RefusedError: see `put`.
        """
        async with self._desk.changing:
            await self.put(changes)

    async def put(self, changes: Mapping[str, Any], recorded: bool = True) -> None:
        """Set parameters of the running node, or start it again with them.

        Args:
            changes: values by name.
            recorded: whether they become a step of the history.

        Raises:
            RefusedError: the node refuses them, or does not answer; nothing is changed.
        """
        if not self._fixed.isdisjoint(changes):
            await self.restart(changes, recorded)
            return
        before = {name: self.values[name] for name in changes if name in self.values}
        # Known beforehand: the event that reports it must not look like a change by somebody else.
        self.values.update(changes)
        try:
            await self._desk.system.set(self._node, changes)
        except RefusedError:
            self.values.update(before)
            raise
        self._shows(changes)
        if recorded:
            self._desk.changes.record(self._node, before, changes)

    async def restart(self, changes: Mapping[str, Any] | None = None, recorded: bool = True) -> None:
        """Start the node again with changed parameters, and read them.

        Raises:
            RefusedError: see `Nodes.restart`; or the node does not come back.
        """
        nodes = self._owned
        begun = list(nodes.parameters) if self._node == "simulator" else [self._node]
        await nodes.restart(self._node, changes)
        await self._back(begun, recorded)

    async def start_again(self) -> None:
        """Start the node again as it was, after it has ended; the others go on.

        Raises:
            RefusedError: it runs, was not started by this page, or does not come back.
        """
        await self._owned.start_again(self._node)
        await self._back([self._node], recorded=False)

    @property
    def _owned(self) -> Nodes:
        self._desk.require_free()
        if self._desk.nodes is None:
            how = how_to_start(self._node, EXECUTABLES, self._desk.system.namespace)
            raise RefusedError(f"{self._node} was not started by this page: {how}")
        return self._desk.nodes

    async def _back(self, begun: Sequence[str], recorded: bool) -> None:
        """Wait until the node answers, and read its parameters; `begun`: the nodes that were started."""
        nodes, before = self._owned, self.values
        for node in begun:
            self._desk.system.lives.begin(node)
        while True:
            try:
                await self._read()
                break
            except RefusedError:
                if ended := nodes.ended(self._node):
                    raise RefusedError(
                        f"{self._node} {ended}; its last lines:\n{nodes.last_words(self._node)}"
                    ) from None
        if recorded:
            self._desk.changes.record(self._node, before, self.values)
        self._catch_up()
        self._desk.system.note(f"{', '.join(begun)} started again")

    def follow(self, changes: Mapping[str, Any]) -> None:
        """Show what has changed according to the node; a new start of the node by the page uses it."""
        if self._building.locked():
            self._reported.append(changes)
            return
        known = {name: self.values[name] for name in changes if name in self.values}
        self._desk.changes.record(self._node, known, {name: changes[name] for name in known}, "by another program")
        self._shows(changes)
        if self._desk.nodes is not None:
            self._desk.nodes.remember(self._node, changes)

    def _shows(self, changes: Mapping[str, Any]) -> None:
        self.values.update(changes)
        for form in self._forms:
            form.show(changes)

    async def read_again(self) -> None:
        """Read the parameters of a node that has come back: it may have been started with others.

        Raises:
            RefusedError: see `System.described`.
        """
        before = self.values
        await self._read()
        if self._desk.nodes is None:
            before, after = ({n: v for n, v in each.items() if n not in self._fixed} for each in (before, self.values))
            self._desk.changes.record(self._node, before, after, "after a new start by another program")
        self._catch_up()
