"""The last measured positions: they tell how the arm moves even if the newest measurement is wrong."""

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.state import HISTORY, ControllerState, Count, Time, part
from pidtsm_core.signals import Signal
from pidtsm_core.timing import NANOSECONDS, seconds

_INTERVAL = NANOSECONDS // 400
"""ns; a measurement is noted if the last one that was noted is at least this old."""
_OLDEST, _OLDEST_OF_PERIODS = NANOSECONDS // 10, 10
"""ns, nominal periods; older measurements say nothing about the present motion."""
RECENT = 5
"""Measurements that show the present motion; all of them show it with less noise, but later."""


@inlined
def note(state: ControllerState, stamp: int) -> None:
    """Note the measurement of `stamp` (ns), unless one was noted shortly before."""
    counts, times = state.counts, state.times
    if counts[Count.NOTES] > 0 and stamp - times[Time.NOTED] < _INTERVAL:
        return
    row = counts[Count.NOTES] % HISTORY
    for j in range(state.measured.size):
        state.history[row, j] = state.measured[j]
        state.history_efforts[row, j] = state.sent[j]
    state.history_stamps[row] = stamp
    times[Time.NOTED] = stamp
    counts[Count.NOTES] += 1


@part
def shift_history(state: ControllerState, later: int) -> None:
    """Shift the stamps of all notes by `later` (ns), because the clock of the stamps was set."""
    state.times[Time.NOTED] += later
    for row in range(HISTORY):
        state.history_stamps[row] += later


@part
def noted_motion(state: ControllerState, stamp: int, joint: int, most: int) -> tuple[float, float]:
    """Position (rad) at `stamp` (ns) and velocity (rad/s) of a joint by its newest notes, `most` of them at most.

    The velocity is the median of the slopes between pairs of notes (Theil, "A rank-invariant method of linear
    and polynomial regression analysis", 1950), which no single wrong measurement changes by much; the position is the
    median of what the notes predict with it. Without two recent notes, the arm is where it is measured, with the
    estimated velocity.
    """
    count = _recent_notes(state, stamp, most)
    if count < 2:
        return state.measured[joint], state.signals[Signal.VELOCITY, joint]
    velocity = _median_slope(state, joint, count)
    for i in range(count):
        place, below = _predicted(state, stamp, joint, i, velocity), 0
        for k in range(count):
            other = _predicted(state, stamp, joint, k, velocity)
            below += int(other < place or (other == place and k < i))
        if below == count // 2:
            break
    return place, velocity


@part
def noted_acceleration(state: ControllerState, stamp: int, joint: int) -> float:
    """Acceleration of a joint by its notes at `stamp` (ns), rad/s^2: how the newest differ in velocity from all."""
    _, recent = noted_motion(state, stamp, joint, RECENT)
    _, all_ = noted_motion(state, stamp, joint, HISTORY)
    apart = _span(state, _recent_notes(state, stamp, HISTORY)) - _span(state, _recent_notes(state, stamp, RECENT))
    return 2.0 * (recent - all_) / apart if apart > 0.0 else 0.0


@part
def noted_effort(state: ControllerState, stamp: int, joint: int) -> float:
    """Median of the noted efforts on a joint, N m: no single command decides."""
    count = _recent_notes(state, stamp, HISTORY)
    for i in range(count):
        effort, below = state.history_efforts[_row(state, i), joint], 0
        for k in range(count):
            other = state.history_efforts[_row(state, k), joint]
            below += int(other < effort or (other == effort and k < i))
        if below == count // 2:
            return effort
    return state.sent[joint]


@inlined
def _recent_notes(state: ControllerState, stamp: int, most: int) -> int:
    """Number of the newest notes that are recent at `stamp` (ns), `most` at most."""
    times, counts, count = state.times, state.counts, 0
    oldest = max(_OLDEST, _OLDEST_OF_PERIODS * times[Time.PERIOD])
    most = min(most, counts[Count.NOTES], HISTORY)
    while count < most and stamp - state.history_stamps[_row(state, count)] <= oldest:
        count += 1
    return count


@inlined
def _span(state: ControllerState, count: int) -> float:
    """Time between the first and the last of the newest notes, s."""
    return seconds(state.history_stamps[_row(state, 0)] - state.history_stamps[_row(state, max(count - 1, 0))])


@inlined
def _row(state: ControllerState, age: int) -> int:
    """Row of the newest note (`age` 0), of the one before (1), and so on."""
    return (state.counts[Count.NOTES] - 1 - age) % HISTORY


@inlined
def _predicted(state: ControllerState, stamp: int, joint: int, note_: int, velocity: float) -> float:
    """Position at `stamp` (ns) that a note predicts with a velocity, rad."""
    row = _row(state, note_)
    return state.history[row, joint] + velocity * seconds(stamp - state.history_stamps[row])


@inlined
def _slope(state: ControllerState, joint: int, newer: int, older: int) -> float:
    """Slope between two notes, rad/s."""
    a, b = _row(state, newer), _row(state, older)
    return (state.history[a, joint] - state.history[b, joint]) / seconds(
        max(state.history_stamps[a] - state.history_stamps[b], 1)
    )


@part
def _median_slope(state: ControllerState, joint: int, count: int) -> float:
    """Median of the slopes between the newest notes, rad/s; of many notes, only between those half of them apart.

    It is found by its rank, because compiled code has no memory to sort in.
    """
    apart = 1 if count <= RECENT else count // 2
    pairs = (count - apart) * (count - apart + 1) // 2
    for i in range(count - apart):
        for k in range(i + apart, count):
            slope, below = _slope(state, joint, i, k), 0
            for m in range(count - apart):
                for n in range(m + apart, count):
                    other = _slope(state, joint, m, n)
                    below += int(other < slope or (other == slope and (m, n) < (i, k)))
            if below == pairs // 2:
                return slope
    return 0.0
