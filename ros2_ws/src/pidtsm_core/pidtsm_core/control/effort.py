"""Limits of the effort, and the effort that carries the arm."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.lateness import command_drives
from pidtsm_core.control.state import ControllerState, Count, Time, part
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Limited, Signal
from pidtsm_core.timing import seconds

_DIFFERENT = 0.05
"""Share of a joint's effort limit by which the applied effort may differ from the commanded one."""
# As floats, like the signals.
_AT_LIMIT, _AT_RATE = float(Limited.EFFORT), float(Limited.RATE)


LARGEST_CHANGE = 0.08
"""Largest change of the safe effort from one command to the next, as a share of the effort limit."""


_KNOWN = 10
"""Number of samples after which their nominal period is known."""


@inlined
def time_of_change(state: ControllerState) -> float:
    """Time in which the safe effort can change by the effort limit, s; 0: not known yet."""
    known = state.counts[Count.ANSWERED] > _KNOWN
    return seconds(state.times[Time.PERIOD]) / LARGEST_CHANGE if known else 0.0


@part
def carry(config: ControllerConfig, state: ControllerState, q: Array) -> None:
    """Write the effort that carries the arm at rest at q (shape (joints,), rad) to the signals."""
    y = state.signals
    for j in range(q.size):
        state.accelerations[0, j] = 0.0
        state.accelerations[1, j] = 0.0
    efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    inverse_dynamics(config.model, q, state.accelerations[0], state.accelerations, efforts)
    add_offset(config, efforts, 1.0)


@inlined
def feed_offset(config: ControllerConfig, state: ControllerState) -> None:
    """Add the constant efforts to what goes beyond the law's effort, if the law compensates anything."""
    if config.compensates and config.offsets:
        for j in range(state.added.size):
            state.added[j] += config.compensation.offset[j]


@inlined
def add_offset(config: ControllerConfig, efforts: Array, sign: float) -> None:
    """Add the constant effort of each joint, times a sign, to every row of efforts, shape (rows, joints), N m."""
    if config.offsets:
        for i in range(efforts.shape[0]):
            for j in range(efforts.shape[1]):
                efforts[i, j] += sign * config.compensation.offset[j]


@inlined
def write_net_effort(state: ControllerState, effort: Array) -> None:
    """Write the effort that accelerates the arm to ``state.net``, without what was added for a load the model lacks.

    Args:
        state: state, which is changed.
        effort: of the last tick, shape (joints,), N m.
    """
    for j in range(effort.size):
        state.net[j] = effort[j] - state.added[j]


@inlined
def held_back(config: ControllerConfig, state: ControllerState, joint: int) -> bool:
    """Whether the effort applied over the last period was not that of the law."""
    y = state.signals
    if y[Signal.SATURATED, joint] != 0.0:
        return True
    allowed = _DIFFERENT * config.limits.effort[joint]
    expected = state.delivered[joint] if config.drive.late else y[Signal.EFFORT, joint]
    return config.feeds_back and abs(state.applied[joint] - expected) > allowed


@inlined
def write_command(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Store the efforts as sent, and write the command for the arm: without gravity if the arm's firmware adds it.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        dt: time since the last command in which the drives are known to have followed it, s; 0: they may have done
            anything.
    """
    for j in range(state.sent.size):
        state.sent[j] = state.output[j] = state.signals[Signal.EFFORT, j]
    if config.drive.late:
        command_drives(config, state, dt)
    if config.robot_adds_gravity:
        added_gravity(config, state)
        for j in range(state.sent.size):
            state.output[j] -= state.scratch[0, j]


@part
def added_gravity(config: ControllerConfig, state: ControllerState) -> None:
    """Write the effort that the arm's firmware adds at the estimated position to ``state.scratch[0]``, N m."""
    still, gravity = state.accelerations, state.scratch[:1]
    for j in range(still.shape[1]):
        still[0, j] = 0.0
    inverse_dynamics(config.firmware, state.signals[Signal.POSITION], still[0], still[:1], gravity)
    for j in range(still.shape[1]):
        gravity[0, j] = gravity[0, j] if math.isfinite(gravity[0, j]) else 0.0


@inlined
def limit_effort(config: ControllerConfig, state: ControllerState) -> None:
    """Limit the efforts; an effort that is not finite becomes 0."""
    y = state.signals
    for j in range(y.shape[1]):
        limit = config.limits.effort[j]
        effort = y[Signal.EFFORT, j]
        if math.isfinite(effort):
            y[Signal.EFFORT, j] = min(max(effort, -limit), limit)
            y[Signal.SATURATED, j] = _AT_LIMIT if abs(effort) >= limit else 0.0
        else:
            y[Signal.EFFORT, j] = 0.0
            y[Signal.SATURATED, j] = _AT_LIMIT


@part
def rate_delay(config: ControllerConfig, state: ControllerState, dt: float) -> float:
    """The delay of the effort that `limit_rate` would cause and return, s."""
    behind = 0.0
    for j in range(state.sent.size):
        rate = config.limits.effort_rate[j]
        if rate > 0.0:
            beyond = abs(state.signals[Signal.EFFORT, j] - state.sent[j]) - rate * dt
            behind = max(behind, beyond / rate)
    return behind


@part
def limit_rate(config: ControllerConfig, state: ControllerState, dt: float) -> float:
    """Limit the change of the efforts since the last command, dt (s) ago.

    Returns:
        Delay of the effort, s: the time that it needs, at the limited rate, to reach the value that was demanded; the
        longest of all joints.
    """
    y, last, behind = state.signals, state.sent, 0.0
    for j in range(last.size):
        rate = config.limits.effort_rate[j]
        if rate > 0.0:
            change = rate * dt
            wanted = y[Signal.EFFORT, j]
            allowed = min(max(wanted, last[j] - change), last[j] + change)
            if allowed != wanted:
                y[Signal.EFFORT, j] = allowed
                y[Signal.SATURATED, j] += _AT_RATE
                behind = max(behind, abs(wanted - allowed) / rate)
    return behind
