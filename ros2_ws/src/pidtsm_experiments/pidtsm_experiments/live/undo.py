"""The history of changes on the page, and the buttons that undo them."""

from collections.abc import Mapping
from html import escape
from typing import Any

from viser import GuiEvent

from pidtsm_experiments.live.changes import LARGE, is_large
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.forms import NodeForms

_SHOWN = 8
"""Steps that are shown, the newest first."""


class Undo:
    """What has been changed since the page began, and the way back.

    One step back needs no confirmation: its values were in force before, and whoever sees an arm shake needs one click.
    """

    def __init__(self, desk: Desk, forms: Mapping[str, NodeForms]) -> None:
        """Add it to the current container; it is hidden until the first change. `forms`: by node."""
        self._desk, self._forms, gui = desk, forms, desk.server.gui
        self._folder = gui.add_folder("Changes", visible=False)
        with self._folder:
            desk.button("Undo", lambda: self._undo(1), "set the values from before the last change; again: one more")
            everything = gui.add_button("All back to the start", hint="set the values from when the page began")
            self._html = gui.add_html("")

        @everything.on_click
        def _(event: GuiEvent[Any]) -> None:
            if desk.system.simulated or not self._large():
                desk.run(self._undo(len(desk.changes.steps)))
                return
            question = (
                f"All changes are undone together, some by more than a factor of {LARGE:g}. "
                "Is everybody out of its reach?"
            )
            desk.confirm(event.client, question, "Undo all", lambda: self._undo(len(desk.changes.steps)))

    def _large(self) -> bool:
        """Whether a value changes much if all is undone."""
        values = self._desk.changes.back(len(self._desk.changes.steps))
        known = {node: forms.values for node, forms in self._forms.items()}
        return any(
            is_large(known.get(node, {}).get(name), value)
            for node, found in values.items()
            for name, value in found.items()
        )

    async def _undo(self, count: int) -> None:
        """Undo the last steps, node by node."""
        async with self._desk.changing:
            changes = self._desk.changes
            steps = changes.steps[len(changes.steps) - count :] if count else []
            if not steps:
                raise RefusedError("there is nothing to undo")
            for node, values in changes.back(count).items():
                if values:
                    await self._forms[node].put(values, recorded=False)
                undone = [step for step in steps if step.node == node]
                changes.remove(undone)
                self._desk.system.note(f"undone: {'; '.join(str(step) for step in reversed(undone))}")

    def show(self) -> None:
        """Show the history."""
        steps = self._desk.changes.steps
        # It appears once, and keeps its height: what is below must not move away from a mouse that is about to press.
        if steps and not self._folder.visible:
            self._folder.visible = True
        lines = "".join(f"<div>{step.at} {escape(str(step))}</div>" for step in reversed(steps[-_SHOWN:]))
        more = f"<div>and {len(steps) - _SHOWN} before</div>" if len(steps) > _SHOWN else ""
        self._html.content = (
            '<div id="changes" style="padding:0 0.75em 0.5em;font-size:0.8em;height:4.5em;overflow-y:auto;'
            f'overflow-wrap:anywhere">{lines}{more}</div>'
        )
