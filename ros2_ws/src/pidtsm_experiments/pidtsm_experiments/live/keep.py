"""Controls that keep something: a recording, or the gains."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.parameters.files import ros_parameters
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.recording import Recording
from pidtsm_experiments.runs.files import write_file
from pidtsm_experiments.runs.origin import comment

_RECORD, _END = "Record", "End the recording"
_GAINS = ("law.", "estimator.", "compensation.")


class Recorded:
    """Recording on and off, with path and size of the bag."""

    def __init__(self, desk: Desk, recording: Recording, values: Callable[[], Mapping[str, Mapping[str, Any]]]) -> None:
        """Add the controls to the current container; `values`: returns the parameters of the nodes, by node."""
        self._desk, self._recording, self._values = desk, recording, values
        hint = "record every topic to a new bag, until it is pressed again"
        self._button = desk.button(_RECORD, self._toggle, hint, color="red")
        self._path = desk.server.gui.add_html("")

    def show(self) -> None:
        """Show where the recording is."""
        bag, so_far = self._recording.bag, self._recording.text
        label = _END if self._recording.on else _RECORD
        if self._button.label != label:
            self._button.label = label
        if bag is not None:
            what = f"{so_far} recorded"
            if self._recording.on:
                what = f"recording, {so_far} so far"
            elif why := self._recording.incomplete:
                what = f"recorded without its end, because {why}"
            self._path.content = (
                f'<div id="bag" style="padding:0.5em 0.75em;overflow-wrap:anywhere">{what}: {bag}</div>'
            )

    async def _toggle(self) -> None:
        await (self._stop() if self._recording.on else self.start())

    async def start(self) -> None:
        """Begin a new bag.

        Raises:
            RefusedError: see `Recording.start`.
        """
        bag = self._recording.start(self._desk.scenario, self._values())
        self._desk.system.note(f"recording to {bag}")

    async def _stop(self) -> None:
        bag = await self._recording.stop()
        self._desk.system.note(f"recorded {bag}")


class Saved:
    """Writes law, estimator and gains to a parameter file."""

    def __init__(self, desk: Desk, values: Callable[[], Mapping[str, Any]]) -> None:
        """Add the button to the current container; `values`: returns the parameters of the controller."""
        self._desk, self._values = desk, values
        hint = "write law, estimator and gains to a file, for ./pidtsm run --params FILE"
        desk.button("Save these gains", self._save, hint)
        self._path = desk.server.gui.add_html("")

    async def _save(self) -> None:
        values = self._values()
        file = self._desk.folder / f"{values['law.name']}-{time.strftime('%Y-%m-%d-%H-%M-%S')}.yaml"
        try:
            save_gains(file, values)
        except (OSError, RunError) as error:
            raise RefusedError(f"the gains are not saved: {error}") from None
        self._path.content = f'<div id="gains" style="padding:0.5em 0.75em;overflow-wrap:anywhere">saved: {file}</div>'
        self._desk.system.note(f"saved {file}")


def save_gains(file: Path, values: Mapping[str, Any]) -> None:
    """Write law, estimator and gains of a controller to a parameter file.

    Args:
        file: the file; its folder is created.
        values: every parameter of the controller, by name.

    Raises:
        OSError: its folder cannot be made.
        RunError: it cannot be written.
    """
    gains = {name: value for name, value in values.items() if name.startswith(_GAINS)}
    file.parent.mkdir(parents=True, exist_ok=True)
    write_file(file, comment() + ros_parameters("controller", gains))
