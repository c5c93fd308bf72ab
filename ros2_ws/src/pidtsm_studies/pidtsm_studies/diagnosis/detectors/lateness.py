"""A late drive, from how much later the reported effort follows the command.

A command that answers the joint state of stamp t is reported, by a drive without delay, in the next joint state. A
drive that delays by D and lags by T reports it later by D + T, as long as the command changes slowly against 1/T. The
shift that makes both agree best is the sum.
"""

import numpy as np

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
_FASTEST = 15.0
"""Hz, of what is compared."""
_COARSE = 0.02
"""s between the samples that are compared."""
_STILL = 0.01
"""rad/s or m/s, below which friction goes to zero."""
_AGREES = 0.7
"""Share of the effort's variance that the shifted command must explain."""
_WHY = "the recording lacks command or reported effort; record joint_commands, and joint states with effort, as well"


def late_drive(loop: Loop) -> Verdict:
    """Find the shift between command and reported effort."""
    if loop.command is None or loop.observed.effort_is_command:
        return unknown(Cause.LATE_DRIVE, _WHY)
    shifts = np.arange(0.0, _LONGEST, _STEP)
    effort, command = _changes(loop)
    left = np.stack([_left(loop, effort, command, shift) for shift in shifts])  # shape (shifts, joints)
    best = left.min(axis=0)
    usable = best < 1.0 - _AGREES
    if not usable.any():
        return unknown(Cause.LATE_DRIVE, "effort and command do not resemble each other enough to compare their times")
    late = shifts[left.argmin(axis=0)] - loop.period
    weights = np.where(usable, 1.0 / (best + 0.01), 0.0)
    value = float(np.average(late, weights=weights))
    limit = _LARGEST + _PERIODS * loop.period
    found = value > limit
    joint = int(weights.argmax())
    curve = Curve(loop.joints[joint], 1e3 * (shifts - loop.period), left[:, joint])
    text = f"commands act {1e3 * value:.3g} ms late"
    return Verdict(
        Cause.LATE_DRIVE,
        State.FOUND if found else State.FINE,
        text,
        (),
        value,
        limit,
        "s",
        f"tell the controller: --set controller.drive.lag={value:.3f}; or lower the bandwidth: ./pidtsm gains --robot "
        f"ROBOT --delay {value:.3f}"
        if found
        else "",
        (Plot("Effort that the command does not explain", "assumed delay [ms]", "share of the variance", (curve,)),),
    )


def _left(loop: Loop, effort: Array, command: Array, shift: float) -> Array:
    """Share of each effort's variance that the command of `shift` (s) earlier does not explain, shape (joints,).

    Efforts that are measured behind the gear lack its friction, so friction may explain a part, too.
    """
    every = max(1, round(_COARSE / loop.period))
    time = loop.time[round(_LONGEST / loop.period) + 1 :: every]
    rows = np.searchsorted(loop.time, time)
    shares = []
    for j in range(len(loop.joints)):
        friction = np.tanh(loop.velocity[rows, j] / _STILL)
        columns = np.stack([np.interp(time - shift, loop.time, command[:, j]), friction, 0.0 * time + 1.0], axis=1)
        y = effort[rows, j]
        rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        shares.append(np.var(rest) / (np.var(y) + 1e-30))
    return np.array(shares)


def _changes(loop: Loop) -> tuple[Array, Array]:
    """Effort, and command within the efforts that the drive has shown, below `_FASTEST`, shape (samples, joints)."""
    assert loop.command is not None
    low, high = loop.effort.min(axis=0), loop.effort.max(axis=0)
    return loop.smooth(loop.effort, _FASTEST), loop.smooth(np.clip(loop.command, low, high), _FASTEST)
