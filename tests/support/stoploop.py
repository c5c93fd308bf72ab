"""The compiled parts of the search for bad stops: the closed loop with its faults, the best braking, and energy.

The loop is that of a rollout, with three additions: it falsifies measurements, it pushes the arm, and while no joint
state arrives it asks the controller for the safe torque every 5 ms, as the node does.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import lend
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.control.step import respond, stop_after, stop_now
from pidtsm_core.references import MotionConfig, evaluate_motion
from pidtsm_core.robots import Model, forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Fault
from pidtsm_core.simulation.simulator import act, sense
from pidtsm_core.simulation.simulator_state import SimulatorConfig, SimulatorState
from pidtsm_core.timing import seconds, track_period

_STALE = int(Fault.STATE_STALE)
_EVERY = 5_000_000
"""ns between two safe torques without a joint state."""
_SLOW, _LONGEST = 0.02, 2.0
"""rad/s or m/s, and s: when the best braking ends."""
STEP = 0.1
"""Largest change of a torque from one command to the next, as a share of its limit."""


class Kind(IntEnum):
    """What an event does to a joint."""

    OFF = 0  # its encoder is wrong by `size`, rad or m
    MIRRORED = 1  # its encoder counts backwards from where it is
    NEGATED = 2  # its encoder has its sign flipped
    FROZEN = 3  # its encoder keeps its value
    PUSH = 4  # something pushes it with `size`, N m or N
    LOSS = 5  # no joint state arrives, of any joint
    LOCKED = 6  # commands do not arrive, of any joint: brakes close


class Falsified(NamedTuple):
    """The events of a case in the form that compiled code reads and changes."""

    table: Array  # kind, joint, first sample, first sample after it, size; shape (events, 5)
    memory: Array  # what the encoder read when the event began, nan before; shape (events,)


class LoopParts(NamedTuple):
    """Controller, robot and motion in the form that compiled code reads and changes."""

    controller: int  # its address
    position: Array
    measured_effort: Array  # what the drives report, shape (joints,)
    desired: Array
    effort: Array
    state_stop: int  # ns
    hardware: SimulatorConfig
    robot: SimulatorState
    motion: MotionConfig
    period: int  # ns


class Trace(NamedTuple):
    """What happened, one row per sample."""

    position: Array  # true q at the sample, shape (samples, joints)
    velocity: Array  # true q'
    command: Array  # the newest command at the sample
    applied: Array  # torque of the motors over the period that begins with the sample
    push: Array  # torque of what pushes the arm over that period
    sent: NDArray[np.bool_]  # whether the command is a new one
    fault: NDArray[np.uint8]


@njit
def _falsify(events: Falsified, k: int, measured: Array) -> bool:
    """Falsify the measurement of sample k; return whether it is lost."""
    table, lost = events.table, False
    for i in range(table.shape[0]):
        if table[i, 2] <= k < table[i, 3]:
            kind, joint = int(table[i, 0]), int(table[i, 1])
            if kind == Kind.LOSS:
                lost = True
            elif kind < Kind.PUSH:
                if math.isnan(events.memory[i]):
                    events.memory[i] = measured[joint]
                began = events.memory[i]
                if kind == Kind.OFF:
                    measured[joint] += table[i, 4]
                elif kind == Kind.MIRRORED:
                    measured[joint] = 2.0 * began - measured[joint]
                elif kind == Kind.NEGATED:
                    measured[joint] = -measured[joint]
                else:
                    measured[joint] = began
    return lost


@njit
def _disturb(events: Falsified, k: int, push: Array) -> bool:
    """Write the push on the joints at sample k; return whether commands are lost."""
    table, locked = events.table, False
    for j in range(push.size):
        push[j] = 0.0
    for i in range(table.shape[0]):
        if table[i, 2] <= k < table[i, 3]:
            kind = int(table[i, 0])
            if kind == Kind.PUSH:
                push[int(table[i, 1])] += table[i, 4]
            elif kind == Kind.LOCKED:
                locked = True
    return locked


class Progress(IntEnum):
    """Indices of the integers that a simulation continues from."""

    SAMPLE = 0  # the next one
    STOPPED = 1  # sample of the stop, -1: none so far
    ANSWERED = 2  # time of the last joint state, ns, -1: none so far
    ASKED = 3  # time of the last safe torque without one, ns
    USUAL = 4  # period of joint states, ns


def nothing_so_far() -> NDArray[np.int64]:
    """The `Progress` of a simulation that has not begun."""
    return np.array([0, -1, -1, 0, 0], dtype=np.int64)


@njit
def simulate(
    parts: LoopParts, draws: Array, happening: Falsified, progress: NDArray[np.int64], end: int, results: Trace
) -> bool:
    """Continue the loop up to sample `end`, or until the controller stops.

    Args:
        parts: the loop, which is read and changed.
        draws: random numbers of `Randomness`, one row per sample.
        happening: what happens.
        progress: from where it continues, and how far it got, see `Progress`.
        end: exclusive.
        results: filled.

    Returns:
        Whether everything was finite.
    """
    loop, events, trace = lend(parts), lend(happening), lend(results)
    period, arm, push = loop.period, loop.robot.arm, loop.hardware.plant.push
    k, stopped, answered, asked, usual = progress[0], progress[1], progress[2], progress[3], progress[4]
    dt, running, finite = seconds(period), stopped < 0, True
    while k < end and (stopped < 0 or not running):
        for j in range(push.size):
            if not (math.isfinite(arm.position[j]) and abs(arm.derivatives[0, j]) < 1e4):
                finite = False
            trace.position[k, j] = arm.position[j]
            trace.velocity[k, j] = arm.derivatives[0, j]
        if not finite:
            break
        now, sent, fault = k * period, False, 0 if stopped < 0 else int(trace.fault[k - 1])
        sample, measured, _, applied = sense(loop.hardware, loop.robot, draws[k], k)
        for j in range(push.size):
            loop.position[j] = measured[j]
            loop.measured_effort[j] = applied[j]
        lost = _falsify(events, k, loop.position)
        if sample >= 0 and not lost:
            evaluate_motion(loop.motion, seconds(sample * period), loop.desired)
            stamp = sample * period
            status = respond(loop.controller, stamp, stamp)
            usual = track_period(usual, now - answered if answered >= 0 else 0)
            answered, sent, fault = now, True, status[1]
        elif answered >= 0 and now - answered > stop_after(loop.state_stop, usual) and now - asked >= _EVERY:
            stop_now(loop.controller, _STALE, now - answered)
            asked, sent = now, True
            fault = fault if fault else _STALE
        if fault and stopped < 0:
            stopped = k
        locked = _disturb(events, k, push)
        act(loop.hardware, loop.robot, draws[k], k, sent and not locked, loop.effort, seconds(now), dt)
        for j in range(push.size):
            trace.command[k, j] = loop.effort[j]
            trace.applied[k, j] = arm.effort[j]
            trace.push[k, j] = push[j]
        trace.sent[k], trace.fault[k] = sent, fault
        k += 1
    progress[0], progress[1], progress[2], progress[3], progress[4] = k, stopped, answered, asked, usual
    return finite


@njit
def _decelerate(model: Model, limit: Array, period: float, state: Array, work: Array, wanted: Array) -> None:
    """Write the torque that decelerates all joints in proportion to their velocities, as strongly as limits allow.

    Args:
        model: the true arm.
        limit: of the torques, N m, shape (joints,).
        period: time between two commands, s.
        state: q, q', shape (2 or more, joints).
        work: scratch, shape (4 or more, joints).
        wanted: result, N m.
    """
    q, dq, ddq, efforts = state[0], state[1], work[:2], work[2:4]
    for j in range(q.size):
        ddq[0, j], ddq[1, j] = 0.0, dq[j]
    inverse_dynamics(model, q, dq, ddq, efforts)
    share = 0.5 / period
    for j in range(q.size):
        needed = efforts[1, j] - efforts[0, j]
        if needed != 0.0:
            share = min(share, (efforts[0, j] + math.copysign(limit[j], needed)) / needed)
    share = max(share, 0.0)
    for j in range(q.size):
        torque = efforts[0, j] - share * (efforts[1, j] - efforts[0, j])
        wanted[j] = min(max(torque, -limit[j]), limit[j])


def stop_ideally(
    parts: LoopParts, draws: Array, happening: Falsified, progress: NDArray[np.int64], end: int, results: Trace
) -> bool:
    """As `simulate` after a stop, with the torque of the best braking, which knows the true arm and its motion."""
    return bool(_stop_ideally(parts, draws, happening, progress, end, results, np.zeros((7, parts.effort.size))))


@njit
def _stop_ideally(
    parts: LoopParts,
    draws: Array,
    happening: Falsified,
    progress: NDArray[np.int64],
    end: int,
    results: Trace,
    scratch: Array,
) -> bool:
    loop, events, trace = lend(parts), lend(happening), lend(results)
    period, arm, push, plant = loop.period, loop.robot.arm, loop.hardware.plant.push, loop.hardware.plant
    dt, k, n = seconds(period), progress[0], loop.effort.size
    state, work, wanted, finite = scratch[:2], scratch[2:6], scratch[6], True
    while k < end:
        for j in range(n):
            if not (math.isfinite(arm.position[j]) and abs(arm.derivatives[0, j]) < 1e4):
                finite = False
            trace.position[k, j] = state[0, j] = arm.position[j]
            trace.velocity[k, j] = state[1, j] = arm.derivatives[0, j]
        if not finite:
            break
        now = seconds(k * period)
        if plant.payload_begin <= now < plant.payload_end:
            _decelerate(plant.loaded_model, plant.effort_limit, dt, state, work, wanted)
        else:
            _decelerate(plant.model, plant.effort_limit, dt, state, work, wanted)
        for j in range(n):
            most = STEP * plant.effort_limit[j]
            loop.effort[j] += min(max(wanted[j] - loop.effort[j], -most), most)
        locked = _disturb(events, k, push)
        act(loop.hardware, loop.robot, draws[k], k, not locked, loop.effort, now, dt)
        for j in range(n):
            trace.command[k, j] = loop.effort[j]
            trace.applied[k, j] = arm.effort[j]
            trace.push[k, j] = push[j]
        trace.sent[k], trace.fault[k] = True, trace.fault[k - 1]
        k += 1
    progress[0] = k
    return finite


class Braking(NamedTuple):
    """The torque of the best braking, and what limits it."""

    limit: Array  # shape (joints,), N m
    step: float  # largest change from one command to the next, as a share of the limit
    period: float  # s
    late: int  # periods in which the torque stays as it is


@njit
def brake(model: Model, braking: Braking, state: Array, way: Array, fastest: Array, work: Array) -> float:
    """The best braking from a motion of the true arm; see `stopjudge`.

    Args:
        model: the true arm.
        braking: what limits it.
        state: q, q' and the torque applied at first, shape (3, joints); changed.
        way: largest distance of each joint from its first position, filled.
        fastest: largest speed of each joint, filled.
        work: scratch, shape (7, joints).

    Returns:
        How long it took, s.
    """
    q, dq, torque = state[0], state[1], state[2]
    acceleration, first, wanted = work[4], work[5], work[6]
    inner = max(1, math.ceil(braking.period / 1e-3))
    dt = braking.period / inner
    for j in range(q.size):
        first[j], way[j], fastest[j] = q[j], 0.0, abs(dq[j])
    commands = int(_LONGEST / braking.period)
    for command in range(commands):
        _decelerate(model, braking.limit, braking.period, state, work, wanted)
        free, moving = True, 0.0
        for j in range(q.size):
            change, most = wanted[j] - torque[j], braking.step * braking.limit[j]
            free = free and abs(change) <= most
            if command >= braking.late:
                torque[j] += min(max(change, -most), most)
            moving = max(moving, abs(dq[j]))
        if free and moving < _SLOW:
            return command * braking.period
        for _ in range(inner):
            forward_dynamics(model, q, dq, torque, acceleration)
            for j in range(q.size):
                dq[j] += dt * acceleration[j]
                q[j] += dt * dq[j]
                way[j] = max(way[j], abs(q[j] - first[j]))
                fastest[j] = max(fastest[j], abs(dq[j]))
    return _LONGEST


@njit
def kinetic(model: Model, position: Array, velocity: Array, work: Array, energy: Array) -> None:
    """Write the kinetic energy of each sample, J; `work` is scratch, shape (4, joints)."""
    ddq, efforts = work[:2], work[2:4]
    for k in range(energy.size):
        for j in range(position.shape[1]):
            ddq[0, j], ddq[1, j] = 0.0, velocity[k, j]
        inverse_dynamics(model, position[k], velocity[k], ddq, efforts)
        energy[k] = 0.0
        for j in range(position.shape[1]):
            energy[k] += 0.5 * velocity[k, j] * (efforts[1, j] - efforts[0, j])


def falsified(rows: list[tuple[float, ...]]) -> Falsified:
    """Events, see `Falsified.table`."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return Falsified(table, np.full(len(table), np.nan))


def trace_of(samples: int, joints: int) -> Trace:
    """An empty trace."""
    tables: list[Any] = [np.zeros((samples, joints)) for _ in range(5)]
    tables += [np.zeros(samples, dtype=np.bool_), np.zeros(samples, dtype=np.uint8)]
    return Trace(*tables)


def first_samples(trace: Trace, count: int) -> Trace:
    """The first samples of a trace."""
    shorter: list[Any] = [table[:count] for table in trace]
    return Trace(*shorter)
