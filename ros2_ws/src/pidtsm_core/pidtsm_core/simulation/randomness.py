"""Random numbers of a run: one row per sample, reproducible by seed, independent of the size of the drawn blocks."""

from collections.abc import Mapping
from enum import IntEnum

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, Value, as_float

PARAMETERS = (
    Parameter("seed", 0, "seed of all random numbers: the same seed gives the same run", minimum=0, read_only=True),
)

_BLOCK = 1024  # rows that a node draws at once: about one second


class Column(IntEnum):
    """Purposes of random numbers, in the order of a row, where each of the last three has one column per joint."""

    MEASUREMENT_LOSS = 0  # uniform in [0, 1), like the other losses and bursts
    MEASUREMENT_BURST = 1
    COMMAND_LOSS = 2
    COMMAND_BURST = 3
    JITTER = 4  # standard normal, like the noise
    NOISE = 5
    EFFORT_NOISE = 6  # begins 2 `joints` columns before the end of the row
    EFFORT_SENSOR = 7  # its block is the last one, so that it begins `joints` columns before the end of the row


# A column is drawn if its parameter is not 0.
_SWITCHES = {
    Column.MEASUREMENT_LOSS: "dropout.probability",
    Column.MEASUREMENT_BURST: "dropout.burst_rate",
    Column.COMMAND_LOSS: "dropout.command_probability",
    Column.COMMAND_BURST: "dropout.command_burst_rate",
    Column.JITTER: "jitter.std",
    Column.NOISE: "noise.std",
    Column.EFFORT_NOISE: "actuator.noise",
    Column.EFFORT_SENSOR: "effort_sensor.noise",
}


def columns(joints: int) -> int:
    """Length of a row of random numbers."""
    return Column.NOISE + 3 * joints


class Randomness:
    """Independent streams of random numbers, one per column; disabled columns draw nothing."""

    def __init__(self, values: Mapping[str, Value], joints: int) -> None:
        """Args: values: every parameter of the simulator, as returned by `resolve`."""
        self._seed = int(as_float(values["seed"]))
        self._joints = joints
        self._streams: dict[Column, np.random.Generator] = {}
        self.set_parameters(values)

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other parameters from the next row on."""
        self._drawn = [column for column, switch in _SWITCHES.items() if np.any(values[switch])]
        for column in self._drawn:
            if column not in self._streams:
                # The same as SeedSequence(seed).spawn(), but without creating the other children.
                child = np.random.SeedSequence(self._seed, spawn_key=(column,))
                self._streams[column] = np.random.default_rng(child)
        self._block = np.empty((0, 0))
        self._next = 0

    def draw(self, samples: int) -> Array:
        """The next rows, shape (samples, columns), order of `Column`; 0 in disabled columns."""
        rows = np.zeros((samples, columns(self._joints)))
        for column in self._drawn:
            stream = self._streams[column]
            if column >= Column.NOISE:
                first = Column.NOISE + (column - Column.NOISE) * self._joints
                rows[:, first : first + self._joints] = stream.standard_normal((samples, self._joints))
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
