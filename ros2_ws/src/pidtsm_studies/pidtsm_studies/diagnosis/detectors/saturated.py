"""A saturated drive, from efforts that stay at their largest value.

Of a drive at its limit, one of four things is seen: the effort stays exactly at its largest value; it stays at the
limit of the description; the command exceeds the effort where the effort is at its largest; or it exceeds the effort
while the joint is driven back, when friction would help the command. A drive that is only late has command and effort
apart in both directions, one at its limit only outwards.
"""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict

_LARGEST = 0.01
"""Share of the samples at the limit that needs no mention."""
_EXACT, _NEAR = 0.9999, 0.98
"""Shares of the largest effort, and of a limit, that count as it."""
_BEYOND, _CLEARLY = 1.02, 1.5
"""Ratio of command and effort from which on the drive is called short of effort, and factor of their usual difference.
"""
_BACK, _LACKING = 0.02, 0.3
"""rad/s or m/s from which on a joint is driven back, and how much effort it then lacks, as a share of its largest."""
_SLOW = 3.0
"""Hz, of what is compared."""
_SHORTEST = 0.3
"""s."""


def saturation(loop: Loop, limit: Array | None, late: float = 0.0) -> Verdict:
    """Count the samples at the limit.

    Args:
        loop: the recording.
        limit: of the description, shape (joints,), N m or N; None: not known.
        late: how late the drives are, s: their effort is compared with the command of that time before.
    """
    effort = loop.observed.effort
    size = np.abs(effort)
    largest = np.maximum(np.nanmax(size, axis=0), 1e-9)
    at_limit = size >= _EXACT * largest
    if limit is not None:
        at_limit |= size >= _NEAR * limit
    # An effort that never changes, such as 0 of a joint that bears no load, is no limit.
    changes = np.ptp(effort, axis=0) > 0.02 * largest
    shares = [np.where(changes, _lasting(at_limit, loop.observed.period), 0.0)]
    if loop.command is not None:
        shares += [_lasting(each, loop.period) for each in _short(loop, late)]
    share = np.max(shares, axis=0)
    order = np.argsort(-share)
    found = [int(j) for j in order if share[j] > _LARGEST]
    worst = int(order[0])
    unit = loop.observed.units[worst].effort
    of_time = f"{100.0 * share[worst]:.0f} % of the time"
    text = f"the drive of {loop.joints[worst]} is at its limit of {largest[worst]:.3g} {unit} for {of_time}"
    curves = [Curve("effort", loop.time, loop.effort[:, worst])]
    if loop.command is not None:
        curves.append(Curve("command", loop.time, loop.command[:, worst]))
    return Verdict(
        Cause.SATURATION,
        State.FOUND if found else State.FINE,
        text if found else "no drive is at its limit",
        tuple(loop.joints[j] for j in found),
        float(share[worst]),
        _LARGEST,
        "",
        "move more slowly, carry less, or set what the drive can do: --effort "
        f"{loop.joints[worst]}={largest[worst]:.3g}"
        if found
        else "",
        (Plot(f"Effort of {loop.joints[worst]}", "time [s]", unit, tuple(curves)),),
    )


def _short(loop: Loop, late: float) -> tuple[Array, Array]:
    """Samples whose command exceeds the effort: where it is at its largest, and while the joint is driven back.

    Where the effort is not at its largest, command and effort differ by friction, if it is measured behind the gear,
    and by the lag of the drive; it must be clearly more. Of a joint that moves against its command, friction adds to
    the effort. Both have shape (samples, joints).
    """
    assert loop.command is not None
    answered = np.stack([np.interp(loop.time - late, loop.time, each) for each in loop.command.T], axis=1)
    effort, command = loop.smooth(loop.effort, _SLOW), loop.smooth(answered, _SLOW)
    noise = np.std(loop.rough(loop.effort, 0.25 * loop.rate), axis=0) * np.sqrt(_SLOW / loop.rate)
    largest = np.percentile(np.abs(effort), 99.5, axis=0)
    top = np.abs(effort) > largest - np.maximum(0.01 * largest, 4.0 * noise)
    elsewhere = np.where(top, np.nan, np.abs(command - effort))
    elsewhere[0, top.all(axis=0)] = 0.0
    usual = np.nanpercentile(elsewhere, 95.0, axis=0)
    lacking = np.sign(effort) * (command - effort)
    beyond = lacking > np.abs(effort) * (_BEYOND - 1.0) + _CLEARLY * usual
    back = (np.sign(effort) * loop.velocity < -_BACK) & (lacking > _LACKING * largest)
    return np.asarray(top & beyond), np.asarray(back)


def _lasting(at_limit: Array, period: float) -> Array:
    """Share of the samples that belong to times at the limit longer than `_SHORTEST`, shape (joints,).

    A loop that rings or that is late touches its limits in turn, for short times.
    """
    length = 2 * (round(_SHORTEST / period) // 2) + 1
    lasting = maximum_filter1d(minimum_filter1d(at_limit.astype(np.uint8), length, axis=0), length, axis=0)
    return np.asarray(np.mean(lasting, axis=0))
