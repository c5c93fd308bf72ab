"""A case of a stop, simulated up to the stop, and from there on again and again with other conditions."""

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.parameters import Value, as_float, joint_array, resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.robots import Model
from pidtsm_core.signals import Fault
from pidtsm_core.simulation.actuator import actuator_config
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_core.timing import period_nanoseconds
from support.stopcases import ARMS, Case
from support.stoploop import (
    STEP,
    Braking,
    Kind,
    LoopParts,
    Progress,
    Trace,
    falsified,
    first_samples,
    nothing_so_far,
    simulate,
    trace_of,
)


class Run:
    """A case that has been simulated.

    Attributes:
        case: the case.
        trace: what happened, as far as it is finite.
        stopped: sample of the stop; -1: none.
        finite: whether everything was.
        dt: period, s.
        limit: of the torques, shape (joints,), N m.
        picked: first sample at which the arm carries its payload.
        bandwidth: of the hold, by the parameters, rad/s.
        braking: of the best braking, by which the stop is judged.
        fault: its name; empty: none.
        controller, parts, events: the loop after the last sample.
    """

    def __init__(self, case: Case) -> None:
        arm, self.case = ARMS[case.arm], case
        settings = {"robot.description": arm.description}
        known = resolve(controller_schema, {**settings, **case.controller}, arm.joints)
        values = resolve(simulator_schema, {**settings, **case.simulator}, arm.joints)
        robot = SimulatedRobot(values, ESTIMATORS[str(known["estimator.name"])].needs_truth)
        motion = ReferenceMotion(resolve(reference_schema, {"joints": arm.names, **case.trajectory}, arm.joints))
        rate = int(as_float(values["rate"]))
        self.controller, self.dt = Controller(known), 1.0 / rate
        self.parts = _parts(self.controller, robot, motion, period_nanoseconds(rate))
        self.events = falsified(_table(case, rate))
        self.limit = np.minimum(joint_array(values["limits.effort"], arm.joints), self.controller.config.limits.effort)
        self.bandwidth = as_float(known["stop.bandwidth"])
        self._simulated = values
        self.braking = Braking(self.limit, STEP, self.dt, _late(values, arm.joints))
        until, self._after = round(case.until * rate), round(case.after * rate)
        self._draws = robot.randomness.draw(until + self._after)
        self._progress, self._whole = nothing_so_far(), trace_of(until + self._after, arm.joints)
        self.finite = self._simulate(until, simulate)
        self.stopped = int(self._progress[Progress.STOPPED])
        self.picked = max(0, math.ceil(robot.config.plant.payload_begin / self.dt - 1e-6))
        self.fault = Fault(int(self._whole.fault[self.stopped])).name if self.stopped >= 0 else ""
        self._at_stop = _copies(self._changing)
        if self.stopped >= 0 and self.finite:
            self.finite = self._simulate(self.stopped + self._after, simulate)

    def true(self, sample: int) -> Model:
        """The true arm at a sample."""
        plant = self.parts.hardware.plant
        return plant.loaded_model if sample >= self.picked else plant.model

    @property
    def _changing(self) -> Any:
        return (
            self.controller.config,
            self.controller.state,
            self.controller.effort,
            self.controller.measured,
            self.parts.robot,
            self.parts.hardware,
            self.events,
            self._progress,
        )

    def _simulate(self, end: int, by: Callable[..., bool]) -> bool:
        finite = by(self.parts, self._draws, self.events, self._progress, end, self._whole)
        count = int(self._progress[Progress.SAMPLE])
        self.trace = first_samples(self._whole, count)
        return bool(finite) and bool(np.isfinite(self.trace.command).all())

    def with_other(self, change: Callable[["Run"], None], by: Callable[..., bool] = simulate) -> "Run":
        """The same stop again.

        Args:
            change: changes `controller`, `parts` or `events` after the sample of the stop.
            by: what simulates.
        """
        other = copy.copy(self)
        _restore(self._changing, self._at_stop)
        other._whole = copy.deepcopy(self._whole)
        hardware = self.parts.hardware
        change(other)
        other.finite = other._simulate(other.stopped + other._after, by)
        self.parts = self.parts._replace(hardware=hardware)
        return other

    def change_rate(self, rate: int) -> None:
        """From the sample after the stop on, let joint states and commands come at another rate; for `with_other`.

        Args:
            rate: a multiple of the rate so far, Hz. Delays keep their number of samples, and noise its values in time.
        """
        times, past = round(rate * self.dt), self.stopped + 1
        robot, hardware = self.parts.robot, self.parts.hardware
        drives = actuator_config({**self._simulated, "rate": rate}, self.limit.size)
        self.parts = self.parts._replace(hardware=hardware._replace(actuator=drives), period=period_nanoseconds(rate))
        before: list[Any] = list(self._whole)
        after: list[Any] = list(trace_of(len(self._whole.fault) * times, self.limit.size))
        for old, new in zip(before, after, strict=True):
            new[: past * times] = np.repeat(old[:past], times, axis=0)
        self._whole = Trace(*after)
        self._draws = np.repeat(self._draws, times, axis=0)
        self._progress[[Progress.SAMPLE, Progress.STOPPED]] *= times
        self._progress[Progress.USUAL] = self.parts.period
        self.events.table[:, 2:4] *= times
        robot.measurements.sent[:] = robot.commands.sent[:] = -1  # What is on its way arrives as the next does.
        self.stopped, self.picked, self._after = self.stopped * times, self.picked * times, self._after * times
        self.dt = 1.0 / rate

    def replace_last_command(self, effort: Array) -> None:
        """Let the last command and the torque of the drives be others, shape (joints,), N m; for `with_other`."""
        robot = self.parts.robot
        for last in (self.controller.state.sent, self.parts.effort, robot.command, robot.lagging):
            last[:] = effort
        robot.commands.packets[:, 0] = effort
        self._whole.command[self.stopped - 1 : self.stopped + 1] = effort

    def stretches(self) -> Iterator[slice]:
        """Samples after the stop in which no outside force acts or changes, at least 10 ms each."""
        free = np.flatnonzero(~self.trace.push[self.stopped :].any(axis=1)) + self.stopped
        ends = np.union1d(np.flatnonzero(np.diff(free) > 1) + 1, np.flatnonzero(free == self.picked))
        for part in np.split(free, ends):
            if part.size * self.dt > 0.01:
                yield slice(int(part[0]), int(part[-1]) + 1)


def _late(values: Mapping[str, Value], joints: int) -> int:
    """Samples between a motion of the arm and the torque that answers it."""
    lag = float(joint_array(values["actuator.lag"], joints).max())
    delays = as_float(values["delay.samples"]) + as_float(values["delay.command_samples"])
    return int(delays) + int(np.ceil(lag * as_float(values["rate"])))


def _parts(controller: Controller, robot: SimulatedRobot, motion: ReferenceMotion, period: int) -> LoopParts:
    measured = controller.measured
    return LoopParts(
        controller=controller.address,
        position=controller.position,
        measured_effort=measured[1] if len(measured) > 1 else np.zeros(controller.joints),
        desired=controller.reference,
        effort=controller.effort,
        state_stop=controller.state_stop,
        hardware=robot.config,
        robot=robot.state,
        motion=motion.config,
        period=period,
    )


def _table(case: Case, rate: int) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    for kind, joint, begin, lasts, size in case.events:
        first = round(begin * rate)
        rows.append((float(Kind[kind]), float(joint), float(first), first + max(1.0, round(lasts * rate)), size))
    return rows


def _arrays(nested: Any) -> Iterator[np.ndarray[Any, Any]]:
    if isinstance(nested, np.ndarray):
        yield nested
    elif isinstance(nested, tuple):
        for part in nested:
            yield from _arrays(part)


def _copies(nested: Any) -> list[np.ndarray[Any, Any]]:
    return [array.copy() for array in _arrays(nested)]


def _restore(nested: Any, copies: list[np.ndarray[Any, Any]]) -> None:
    for array, old in zip(_arrays(nested), copies, strict=True):
        array[...] = old
