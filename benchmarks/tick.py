"""One step of the controller and one of the plant: called from Python, like in the nodes, and in a compiled loop."""

from collections.abc import Iterator
from itertools import count as count_from

import numba
import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, Time, controller_schema
from pidtsm_core.control import step as controller_step
from pidtsm_core.control.state import memory_at
from pidtsm_core.parameters import resolve
from pidtsm_core.simulation.plant import Plant, plant_at, plant_schema, step
from pidtsm_experiments.commands.bench import Row, medians

DT = 1e-3
PERIOD = 1_000_000
"""ns."""

# Not cached: Numba cannot load cached functions of this file, since it is not an importable module.
_njit = numba.njit(nogil=True, error_model="numpy", _nrt=False)


@_njit
def _ticks(address: int, count: int) -> None:
    memory = memory_at(address)
    for _k in range(count):
        stamp = memory.state.times[Time.LAST] + PERIOD
        controller_step(memory.config, memory.state, stamp, stamp)


@_njit
def _steps(address: int, effort: Array, count: int) -> None:
    memory = plant_at(address)
    config, state = memory.config, memory.state
    for k in range(count):
        # The same state each time, so that the arm does not diverge.
        for j in range(effort.size):
            state.position[j] = -0.1
            state.derivatives[0, j] = 0.1
        step(config, state, effort, k * DT, DT)


TAKES = 30.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Nanoseconds per step; the lower bound from Python is the cheapest call of a compiled function with arrays."""
    count, repetitions = (1000, 3) if quick else (20_000, 15)
    controller = Controller(resolve(controller_schema, {}, 2))
    plant = Plant(resolve(plant_schema, {}, 2))
    controller.position[:] = 0.1, -0.1
    effort = np.array([30.0, 10.0])

    def many(call: str) -> float:
        def repeated() -> None:
            stamps = count_from(controller.state.times[Time.LAST] + PERIOD, PERIOD)
            for _ in range(count):
                if call == "tick":
                    stamp = next(stamps)
                    controller.step(stamp, stamp)
                elif call == "step":
                    plant.step(effort, 0.0, DT)
                else:
                    _ticks(controller.address, 0)

        return medians(repetitions, repeated)[0] / count * 1e9

    inside = medians(
        repetitions,
        lambda: _ticks(controller.address, count),
        lambda: _steps(plant.address, effort, count),
    )
    empty = many("nothing")
    for label, call, compiled in zip(("controller step", "plant step"), ("tick", "step"), inside, strict=True):
        nanoseconds = many(call)
        yield Row(f"{label}, from Python", nanoseconds, "ns", "the call alone", empty, nanoseconds / empty)
        yield Row(f"{label}, in a compiled loop", compiled / count * 1e9, "ns")
