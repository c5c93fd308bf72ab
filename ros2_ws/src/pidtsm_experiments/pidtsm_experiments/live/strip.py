"""One line for each node: whether it lives, when its last message arrived, and what starts it again."""

import time
from collections.abc import Callable, Coroutine
from html import escape
from typing import Any

from viser import GuiButtonHandle

from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.lives import REPORTS_WITHIN, Condition, Life, how_to_start
from pidtsm_experiments.live.recording import Recording
from pidtsm_experiments.runs.runner import EXECUTABLES

_RECORDER = "recorder"
_LOST = (Condition.SILENT, Condition.DEAD)
StartAgain = Callable[[str], Coroutine[Any, Any, None]]
"""Starts the node of this name again, or raises RefusedError."""


class Strip:
    """The nodes of the system; with a button for each that the page has started and can start again."""

    def __init__(self, desk: Desk, recording: Recording, start_again: StartAgain) -> None:
        """Add it to the current container."""
        self._desk, self._recording = desk, recording
        self._samples = 0
        self._html = desk.server.gui.add_html("")
        owned = () if desk.nodes is None else tuple(desk.nodes.parameters)
        self._buttons = {node: self._button(node, start_again) for node in (*owned, _RECORDER)}

    def _button(self, node: str, start_again: StartAgain) -> GuiButtonHandle:
        hint = "begin a new bag" if node == _RECORDER else "start its process again, with the same arguments"
        return self._desk.button(
            f"Start {node} again", lambda: start_again(node), hint, moves=node != _RECORDER, color="red", visible=False
        )

    def look(self) -> None:
        """See which processes run, and who is in the graph."""
        desk, lives = self._desk, self._desk.system.lives
        desk.system.look()
        if desk.nodes is not None:
            desk.system.source.see(simulator=True, publishers=())
            for node in desk.nodes.parameters:
                lives.end(node, desk.nodes.ended(node), desk.nodes.suspended(node))
        if self._recording.on:
            if self._recording.samples != self._samples or _RECORDER not in lives:
                lives.note_message(_RECORDER, REPORTS_WITHIN)
            self._samples = self._recording.samples
            lives.end(_RECORDER, "")
        elif self._recording.ended:
            lives.end(_RECORDER, f"{self._recording.ended}, so its bag is incomplete")
        else:
            lives.forget(_RECORDER)

    def show(self) -> None:
        """Show what is known now."""
        now, lives = time.monotonic(), self._desk.system.lives
        lines = "".join(self._line(node, lives.of(node), now) for node in lives)
        if not self._desk.system.source.node:
            lines += _line("#868e96", "arm", "nothing publishes joint_states")
        self._html.content = f'<div id="nodes" style="padding:0 0.75em 0.5em;font-size:0.8em">{lines}</div>'
        for node, button in self._buttons.items():
            dead = lives.condition(node) is Condition.DEAD
            if button.visible != dead:
                button.visible = dead

    def _line(self, node: str, life: Life, now: float) -> str:
        sentence, text = life.sentence(now), life.sentence(now).text
        if (life.condition(now) in _LOST or not life.present) and node not in self._buttons:
            text += f"; {how_to_start(node, EXECUTABLES, self._desk.system.namespace)}"
        return _line(sentence.color, node, text)


def _line(color: str, node: str, text: str) -> str:
    return (
        f'<div style="overflow-wrap:anywhere"><span style="color:{color}">●</span> <b>{escape(node)}</b> '
        f"{escape(text)}</div>"
    )
