"""What is wrong with the running loop now: the verdicts of ``./pidtsm diagnose`` on the last seconds."""

import asyncio
import json
import sys
import tempfile
import time
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable, Mapping
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

from viser import GuiEvent

from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.judge import SPAN, Case
from pidtsm_experiments.live.words import AMBER, GREEN, GREY, OLD, RED
from pidtsm_studies.diagnosis.causes import NAMES, Cause

_MODULE = "pidtsm_experiments.live.judge"
_PAGE = "verdicts.html"
_LONGEST = 1 << 20
"""Bytes of a line."""
_STYLE = "padding:0.5em 0.75em;font-size:0.85em;overflow-wrap:anywhere"


class Verdicts:
    """Judges the loop while its box is checked; like a recorder, it then reads the joint states as well."""

    def __init__(self, desk: Desk, values: Callable[[], Mapping[str, Any]]) -> None:
        """Add the controls to the current container; `values`: returns the parameters of the controller."""
        self._desk, self._values = desk, values
        self._process: Process | None = None
        self._newest: dict[str, Any] | None = None
        self._since = ""
        self._folder = tempfile.TemporaryDirectory(prefix="pidtsm-verdicts-")
        hint = f"judge the last {SPAN:g} s again and again, as ./pidtsm diagnose judges a bag"
        self._box = desk.server.gui.add_checkbox("judge the loop", False, hint=hint)
        self._html = desk.server.gui.add_html("")

        @self._box.on_update
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                desk.run(self._switch())

    async def _switch(self) -> None:
        on = bool(self._box.value)
        if on and self._process is None:
            await self._begin()
        elif not on:
            await self._end()

    async def _begin(self) -> None:
        system = self._desk.system
        topics = ("joint_states", "controller/state")
        words = [word for topic in topics for word in ("-r", f"{topic}:={system.topic(topic)}")]
        place = Path(self._folder.name, _PAGE)
        case = Case(dict(self._values()), str(place), system.namespace, words)
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", _MODULE, stdin=PIPE, stdout=PIPE, limit=_LONGEST
        )
        assert process.stdin is not None
        process.stdin.write(f"{case.line()}\n".encode())
        self._process, self._newest = process, None
        self._desk.offered[_PAGE] = place
        self._hearing = asyncio.ensure_future(self._hear(process))

    async def _hear(self, process: Process) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            with suppress(ValueError):  # What a library prints.
                self._newest, self._since = json.loads(line), time.strftime("%H:%M:%S")
        if process is self._process:
            self._process, self._newest = None, {"refused": "the process that judges has ended unexpectedly"}

    async def _end(self) -> None:
        process, self._process, self._newest = self._process, None, None
        if process is not None and process.stdin is not None:
            process.stdin.close()
            await process.wait()

    async def close(self) -> None:
        """End what judges."""
        await self._end()
        self._folder.cleanup()

    def show(self) -> None:
        """Show the newest verdicts."""
        content = self._content()
        if self._html.content != content:
            self._html.content = content

    def _content(self) -> str:
        if self._process is None and self._newest is None:
            return ""
        if self._newest is None or self._desk.system.silence > OLD:
            text = "Waiting for the loop" if self._newest is None else f"The loop is silent; judged at {self._since}"
            return f'<div id="verdicts" style="{_STYLE};color:{GREY}">{text}</div>'
        if reason := self._newest.get("refused"):
            return f'<div id="verdicts" style="{_STYLE};color:{AMBER}">{escape(reason)}</div>'
        return f'<div id="verdicts" style="{_STYLE}">{verdict_list(self._newest, self._since)}</div>'


def verdict_list(found: Mapping[str, Any], since: str) -> str:
    """A diagnosis as HTML, see `judge`; `since`: time of day."""
    color = GREEN if found["good"] else RED
    lines = [f'<div style="color:{color};font-weight:600">{escape(found["sentence"])}</div>']
    for each in found["verdicts"]:
        if each["state"] == "found":
            where = f": {', '.join(each['joints'])}" if each["joints"] else ""
            name = escape(NAMES[Cause(each["cause"])] + where)
            lines.append(f'<div style="margin-top:0.5em"><b style="color:{RED}">{name}</b><br>{escape(each["text"])}.')
            lines.append(f"<br><b>Cure:</b> {escape(each['cure'])}</div>")
    judged = f"{found['duration']:.3g} s until {since} were judged"
    link = f'<a href="{_PAGE}" target="_blank" style="text-decoration:underline">the evidence</a>'
    lines.append(f'<div style="margin-top:0.5em;opacity:0.75">{judged}; {link}</div>')
    return "".join(lines)
