"""A reference that jitters, from its own spectrum.

A motion that was planned has hardly anything above some Hz; a stream of targets that scatter, or that come at irregular
times, has as much there as it scatters. The controller turns it into effort, and the arm rattles, whatever the gains
are: only the reference shows the difference from a loop that rings. The median of its size leaves out single steps.
"""

import numpy as np

from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict, unknown

_ABOVE = 6.0
"""Hz."""
_LARGEST = 1e-4
"""rad or m; standard deviation of the scatter that needs no mention."""
_MEDIAN = 0.6745
"""Median of the size of a Gaussian number, in standard deviations."""
_SHOWN = 2.0
"""s of the plot."""


def command_jitter(loop: Loop) -> Verdict:
    """Judge the desired positions above `_ABOVE`."""
    if loop.reference is None:
        return unknown(Cause.COMMAND_JITTER, "the recording has no reference; record the topic reference as well")
    rough = loop.rough(loop.reference, _ABOVE)
    size = np.median(np.abs(rough), axis=0) / _MEDIAN
    worst = int(size.argmax())
    found = bool(size[worst] > _LARGEST)
    unit = loop.observed.units[worst].position
    middle = slice(len(loop.time) // 2, len(loop.time) // 2 + round(_SHOWN * loop.rate))
    curve = Curve(loop.joints[worst], loop.time[middle], 1e3 * rough[middle, worst])
    text = f"the reference of {loop.joints[worst]} scatters by {1e3 * size[worst]:.2g} m{unit} above {_ABOVE:g} Hz"
    return Verdict(
        Cause.COMMAND_JITTER,
        State.FOUND if found else State.FINE,
        text if found else "the reference is smooth",
        tuple(loop.joints[j] for j in np.argsort(-size) if size[j] > _LARGEST),
        float(size[worst]),
        _LARGEST,
        unit,
        "send trajectories instead of single targets (docs/streams.md), or smooth the targets before they are sent"
        if found
        else "",
        (Plot(f"Reference above {_ABOVE:g} Hz", "time [s]", f"m{unit}", (curve,)),),
    )
