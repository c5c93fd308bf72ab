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

_GAINS = ("law.", "estimator.", "compensation.")


class Recorded:
    """Recording on and off, with the path of the bag."""

    def __init__(self, desk: Desk, recording: Recording, values: Callable[[], Mapping[str, Mapping[str, Any]]]) -> None:
        """Add the controls to the current container; `values`: returns the parameters of the nodes, by node."""
        self._desk, self._recording, self._values = desk, recording, values
        desk.button("Record", self.start, "record every topic to a new bag", color="red")
        desk.button("End the recording", self._stop, "close the bag")
        self._path = desk.server.gui.add_html("")

    def show(self) -> None:
        """Show where the recording is."""
        bag, samples = self._recording.bag, self._recording.samples
        if bag is not None:
            what = "recorded"
            if self._recording.on:
                what = f"recording, {samples} samples so far"
            elif why := self._recording.incomplete:
                what = f"recorded without its end, because {why}"
            self._path.content = (
                f'<div id="bag" style="padding:0.5em 0.75em;overflow-wrap:anywhere">{what}: {bag}</div>'
            )

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
