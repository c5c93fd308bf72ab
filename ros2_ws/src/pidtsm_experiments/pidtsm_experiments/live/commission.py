"""Commissioning by clicks: the same session as that of ``./pidtsm commission``, see `commissioning.guided`."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_experiments.commissioning.consent import QUESTION
from pidtsm_experiments.commissioning.guided import Task
from pidtsm_experiments.commissioning.subjects import subject_of
from pidtsm_experiments.live.commission_words import report_frame, steps, text_of
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.guide import Guide
from pidtsm_experiments.live.withdraw import Withdrawal
from pidtsm_studies.commissioning.result import MJCF, PARAMETERS, REPORT, URDF
from pidtsm_studies.commissioning.session import NAMES, STATE, Session, Subject

_FOLDERS = "commission-"
_OFFERED = (REPORT, PARAMETERS, URDF, MJCF)
_OCCUPIED = "commissioning: the arm is moved and held by a process of its own"
_CARRIED = "The controller gives way: brakes or a support must carry the arm until the first step."
_CEASE = "Commands cease. Do brakes or a support carry the arm?"


class Commissioning:
    """The controls of a session; every browser sees and guides the same one."""

    def __init__(self, desk: Desk, withdrawal: Withdrawal, label: str, values: Callable[[], Mapping[str, Any]]) -> None:
        """Add them to the current container.

        Args:
            desk: of the page.
            withdrawal: of the controller.
            label: of the arm.
            values: returns the parameters of the controller.
        """
        self._desk, self._withdrawal, self._label, self._values = desk, withdrawal, label, values
        self._guide = Guide()
        self._offered: set[str] = set()
        self._before: Mapping[str, Any] = {}
        self._used = self._beginning = False
        gui, button = desk.server.gui, desk.button
        self._text = gui.add_html("")
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._begin = button("Begin", self._go_on, "begin, or go on with, the session", True, _CARRIED, color="green")
        self._agree = button("Agree", self._agreed, "the step begins", True, QUESTION, color="green")
        self._alone = button("Go through all steps", self._all, "agree to this step and all later ones")
        self._stop = button("Stop", self._guide.stop, "the arm comes to rest, and is held", color="red")
        self._use = button("Use the result", self._adopt, "start the controller with the new parameters", color="green")
        self._back = button("Roll back", self._roll_back, "start the controller with the parameters from before")
        self._release = button("Release the arm", self._released, "commands cease", True, _CEASE)
        self._step = gui.add_dropdown("step", NAMES, hint="where to begin again")
        self._repeat = button("Repeat from this step", self._again, "with all later ones, and compare", True)
        self._bags = gui.add_checkbox("bags", True, hint="keep the recordings of each step as bags, too")
        self._new = button("New session", self._fresh, "leave this one as it is, and begin another one")
        self._steps = gui.add_html("")
        self._report = gui.add_html("")
        self._guide.session = self._found()
        if self._guide.held:
            desk.occupied = _OCCUPIED

    # The session.

    def _subject(self) -> Subject:
        return subject_of(self._before or self._values())

    def _found(self) -> Session | None:
        """The newest session of this arm with these parameters."""
        for folder in sorted(self._desk.folder.glob(f"{_FOLDERS}*"), reverse=True):
            if (folder / STATE).exists():
                try:
                    return Session.opened(folder, self._subject())
                except UsageError:
                    continue  # Of another arm.
        return None

    async def _go_on(self, first: str = "") -> None:
        if self._guide.runs or self._beginning:
            raise RefusedError("a session runs already")
        self._beginning = True
        try:
            await self._start(first)
        finally:
            self._beginning = False

    async def _start(self, first: str) -> None:
        session = self._guide.session
        if not self._guide.held:
            self._before = dict(self._values())
            await self._withdrawal.withdraw(_OCCUPIED)
        name = f"{_FOLDERS}{time.strftime('%Y-%m-%d-%H-%M-%S')}"
        folder = self._desk.folder / name if session is None else session.folder
        system = self._desk.system
        topics = [f"{topic}:={system.topic(topic)}" for topic in ("joint_states", "joint_commands")]
        task = Task(
            str(folder),
            self._label,
            self._before or self._values(),
            system.namespace,
            [word for topic in topics for word in ("-r", topic)],
            first,
            bool(self._bags.value),
        )
        self._used = False
        await self._guide.begin(task, self._subject())
        system.note(f"commissioning in {folder}")

    async def _agreed(self) -> None:
        self._guide.agree()

    async def _all(self) -> None:
        if not self._desk.system.simulated:
            raise RefusedError("a person must agree to each step of a real arm")
        self._guide.agree()
        self._guide.alone = True

    async def _again(self) -> None:
        if self._guide.session is None or self._step.value not in self._guide.session.found:
            raise RefusedError(f"{self._step.value} is not done yet")
        await self._go_on(self._step.value)

    async def _fresh(self) -> None:
        if self._guide.runs or self._guide.held:
            raise RefusedError("release the arm of this session first")
        self._guide.session, self._used = None, False
        self._guide.said.clear()
        self._guide.ended = ""

    # The controller.

    async def _released(self) -> None:
        await self._guide.release()
        self._desk.system.note("released: commands have ceased")
        await self._withdrawal.bring_back()

    async def _adopt(self) -> None:
        session = self._guide.session
        if session is None or session.missing or self._guide.runs:
            raise RefusedError("there is no result yet")
        new = load_ros_parameters(session.folder / PARAMETERS)["controller"]
        await self._start_with(new)
        self._used = True

    async def _roll_back(self) -> None:
        await self._start_with(self._subject().before)
        self._used = False

    async def _start_with(self, values: Mapping[str, Any]) -> None:
        if self._guide.held:
            await self._guide.release()
        await self._withdrawal.bring_back(values)

    async def close(self) -> None:
        """End the session; an arm that is not simulated by this page stays held."""
        if self._guide.runs:
            await self._guide.stop()
        if self._guide.held and self._desk.nodes is not None:
            await self._guide.release()
        elif self._guide.held and self._guide.session is not None:
            folder = self._guide.session.folder
            print(f"the arm is held; ./pidtsm commission --out {folder} --release ends that", flush=True)

    # Showing.

    def show(self) -> None:
        """Show the session."""
        guide, session = self._guide, self._guide.session
        waits = guide.asked is not None and guide.since is None
        done = session is not None and not session.missing
        own, held, idle = self._desk.nodes is not None, guide.held, not guide.runs
        if idle and not held and not self._beginning:
            self._desk.occupied = ""
        begins = "Continue" if session is not None and (session.found or held) else "Begin"
        if self._begin.label != begins:
            self._begin.label = begins
        shown = [
            (self._begin, idle and not done),
            (self._agree, waits),
            (self._alone, waits and self._desk.system.simulated),
            (self._stop, guide.runs),
            (self._use, idle and done and own and not self._used),
            (self._back, idle and own and self._used),
            (self._release, idle and held),
            (self._step, idle and session is not None and bool(session.found)),
            (self._repeat, idle and session is not None and bool(session.found)),
            (self._bags, idle),
            (self._new, idle and session is not None and not held),
        ]
        for element, visible in shown:
            if element.visible != visible:
                element.visible = visible
        self._show_progress()
        _set(self._text, text_of(guide, held))
        _set(self._steps, steps(session, guide.asked.step if guide.asked is not None else ""))
        self._show_report(session)

    def _show_progress(self) -> None:
        guide = self._guide
        runs = guide.asked is not None and guide.since is not None
        if self._progress.visible != runs:
            self._progress.visible = runs
        if guide.asked is not None and guide.since is not None:
            share = (time.monotonic() - guide.since) / max(guide.asked.duration, 1.0)
            percent = min(100.0, round(100.0 * share))
            if self._progress.value != percent:
                setattr(self._progress, "value", percent)  # noqa: B010  viser's types do not know that it can be set.

    def _show_report(self, session: Session | None) -> None:
        places: dict[str, Path] = {}
        if session is not None:
            places = {f"{session.folder.name}/{name}": session.folder / name for name in _OFFERED}
        present = {place: file for place, file in places.items() if file.exists()}
        for place in self._offered - present.keys():
            self._desk.offered.pop(place, None)
        self._offered = set(present)
        self._desk.offered.update(present)
        _set(self._report, report_frame(present))


def _set(element: Any, content: str) -> None:
    """Give an HTML element another content; the same would be sent, and a frame loaded, again."""
    if element.content != content:
        element.content = content
