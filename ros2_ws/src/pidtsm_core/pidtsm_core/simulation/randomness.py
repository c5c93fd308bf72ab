"""The random numbers of a run: one row a sample, the same for the same seed however the run is cut into blocks."""

from collections.abc import Mapping
from enum import IntEnum

import numpy as np

from pidtsm_core.parameters import Array, Parameter, Value, as_float

PARAMETERS = (
    Parameter("seed", 0, "seed of all random numbers: the same seed gives the same run", minimum=0, read_only=True),
)

_BLOCK = 1024  # rows drawn at once in a node: about a second


class Column(IntEnum):
    """Columns of a row of random numbers; NOISE is the first of one a joint."""

    MEASUREMENT_LOSS = 0  # uniform in [0, 1), as the other losses
    MEASUREMENT_BURST = 1
    COMMAND_LOSS = 2
    COMMAND_BURST = 3
    JITTER = 4  # standard normal, as the noise
    NOISE = 5


# What makes a column worth drawing.
_SWITCHES = {
    Column.MEASUREMENT_LOSS: "dropout.probability",
    Column.MEASUREMENT_BURST: "dropout.burst_rate",
    Column.COMMAND_LOSS: "dropout.command_probability",
    Column.COMMAND_BURST: "dropout.command_burst_rate",
    Column.JITTER: "jitter.std",
    Column.NOISE: "noise.std",
}


class Randomness:
    """Independent streams of random numbers, one for each purpose; a purpose that is switched off draws nothing."""

    def __init__(self, values: Mapping[str, Value], joints: int) -> None:
        """Args: values: every parameter of the simulator, as `resolve` returns them."""
        self._seed = int(as_float(values["seed"]))
        self._joints = joints
        self._streams: dict[Column, np.random.Generator] = {}
        self.set_parameters(values)

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Draw for other purposes from the next row on."""
        self._drawn = [column for column, switch in _SWITCHES.items() if np.any(values[switch])]
        for column in self._drawn:
            if column not in self._streams:
                # The children of SeedSequence(seed), made without their siblings.
                child = np.random.SeedSequence(self._seed, spawn_key=(column,))
                self._streams[column] = np.random.default_rng(child)
        self._block = np.empty((0, 0))
        self._next = 0

    def draw(self, samples: int) -> Array:
        """The next rows, shape (samples, columns), order of `Column`; 0 where nothing is random."""
        rows = np.zeros((samples, Column.NOISE + self._joints))
        for column in self._drawn:
            stream = self._streams[column]
            if column == Column.NOISE:
                rows[:, column:] = stream.standard_normal((samples, self._joints))
            elif column == Column.JITTER:
                rows[:, column] = stream.standard_normal(samples)
            else:
                rows[:, column] = stream.random(samples)
        return rows

    def next(self) -> Array:
        """The next row, shape (columns,)."""
        if self._next == len(self._block):
            self._block = self.draw(_BLOCK)
            self._next = 0
        self._next += 1
        row: Array = self._block[self._next - 1]
        return row
