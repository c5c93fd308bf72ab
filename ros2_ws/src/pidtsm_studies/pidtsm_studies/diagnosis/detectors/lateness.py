"""A late drive, from how much later the reported effort follows the command.

A command that answers the joint state of stamp t is reported, by a drive without delay, in the next joint state. A
drive that delays by D or lags by T reports it later, shifted or low-passed. The delay or lag that makes both agree
best, of all joints together, is how late it is. Of slow motion, friction explains more than any delay does; so only
what changes faster is compared.
"""

import numpy as np
from scipy.signal import lfilter

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict, unknown

_LARGEST, _PERIODS = 0.013, 1.0
"""s, and periods of the loop: lateness that gains by the rule expect of real drives."""
_LONGEST = 0.12
"""s."""
_STEP = 0.002
"""s."""
_SLOWEST, _FASTEST = 1.0, 40.0
"""Hz, of what is compared."""
_COARSE = 0.01
"""s between the samples that are compared."""
_STILL = 0.01
"""rad/s or m/s, below which friction goes to zero."""
_AGREES = 0.6
"""Share of the effort's variance that the late command must explain, of one joint at least."""
_CLEARLY = 0.25
"""Factor, as a logarithm, by which a late drive explains the efforts better than one that is not."""
_EXACT = 1e-6
"""Share of the variance below which nothing is compared."""
_WHY = "the recording lacks command or reported effort; record joint_commands, and joint states with effort, as well"


def late_drive(loop: Loop) -> Verdict:
    """Find how late the reported effort follows the command."""
    if loop.command is None or loop.observed.effort_is_command:
        return unknown(Cause.LATE_DRIVE, _WHY)
    times = np.arange(0.0, _LONGEST, _STEP)
    left = _left(loop, times)
    # Of independent residuals, the mean logarithm of their variances is the least where a drive is likeliest.
    unlikely = np.log(left + _EXACT).mean(axis=2)
    kind, best = np.unravel_index(unlikely.argmin(), unlikely.shape)
    joint = int(left[kind, best].argmin())
    if left[kind, best, joint] > 1.0 - _AGREES:
        return unknown(Cause.LATE_DRIVE, "effort and command do not resemble each other enough to compare their times")
    value = float(times[best])
    limit = _LARGEST + _PERIODS * loop.period
    found = unlikely[:, times <= limit].min() - unlikely[kind, best] > _CLEARLY
    name, text = ("lag", "drives lag by") if kind else ("delay", "commands are delayed by")
    curve = Curve(loop.joints[joint], 1e3 * times, left[kind, :, joint])
    plot = Plot("Effort that the command does not explain", f"assumed {name} [ms]", "share of the variance", (curve,))
    return Verdict(
        Cause.LATE_DRIVE,
        State.FOUND if found else State.FINE,
        f"{text} {1e3 * value:.3g} ms",
        (),
        value,
        limit,
        "s",
        f"tell the controller: --set controller.drive.{name}={value:.3f}; or lower the bandwidth: "
        f"./pidtsm gains --robot ROBOT --delay {value:.3f}"
        if found
        else "",
        (plot,),
    )


def _left(loop: Loop, times: Array) -> Array:
    """Share of each effort's variance that the command, delayed or lagging by some times (s), does not explain.

    Efforts that are measured behind the gear lack its friction, so friction may explain a part, too. The shares have
    the shape (2, times, joints): of delays, and of lags.
    """
    assert loop.command is not None
    command = np.clip(loop.command, loop.effort.min(axis=0), loop.effort.max(axis=0))
    effort, friction = _compared(loop, loop.effort), _compared(loop, np.tanh(loop.velocity / _STILL))
    every = max(1, round(_COARSE / loop.period))
    rows = np.arange(round(_LONGEST / loop.period) + 1, len(loop.time), every)
    left = np.empty((2, times.size, len(loop.joints)))
    delayed = _compared(loop, command)
    for i, late in enumerate(times):
        share = 1.0 - np.exp(-loop.period / late) if late else 1.0
        lagging = lfilter([share], [1.0, share - 1.0], delayed, axis=0)
        for kind, values, delay in ((0, delayed, late), (1, lagging, 0.0)):
            # A command is answered in the next joint state.
            at = loop.time[rows] - loop.period - delay
            for j in range(len(loop.joints)):
                explaining = np.interp(at, loop.time, values[:, j])
                left[kind, i, j] = _unexplained(effort[rows, j], explaining, friction[rows, j])
    return left


def _compared(loop: Loop, values: Array) -> Array:
    return loop.rough(loop.smooth(values, _FASTEST), _SLOWEST)


def _unexplained(values: Array, *columns: Array) -> float:
    """Share of the variance of values that columns and an offset leave, all of shape (samples,)."""
    table = np.stack([*columns, np.ones_like(values)], axis=1)
    rest = values - table @ np.linalg.lstsq(table, values, rcond=None)[0]
    return float(np.var(rest) / (np.var(values) + 1e-30))
