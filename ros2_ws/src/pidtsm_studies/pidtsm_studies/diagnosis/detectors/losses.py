"""Lost samples, from the stamps.

Joint states come at a constant rate; where one is lost, the difference of the stamps of its neighbours is a multiple of
the period. The median of the differences is the period, whatever is lost, as long as less than half is.
"""

import numpy as np

from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict

_LARGEST = 0.004
"""Share of lost samples that a loop bears."""
_CURE = (
    "look at driver and network: ./pidtsm nodes list and /diagnostics show gaps and rejected messages; "
    "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST keeps others out"
)


def lost_samples(loop: Loop) -> Verdict:
    """Count the joint states that are missing between the first and the last one."""
    time, period = loop.observed.time, loop.period
    steps = np.diff(time) / period
    missing = np.maximum(np.round(steps) - 1.0, 0.0)
    share = float(missing.sum() / (missing.sum() + time.size))
    longest = float(steps.max(initial=1.0)) * period
    found = share > _LARGEST
    lost = f"{100.0 * share:.2g} % are lost, the longest gap is {1e3 * longest:.3g} ms"
    text = f"of the joint states, {lost}" if found else f"joint states arrive at {loop.rate:.4g} Hz; {lost}"
    curve = Curve("time between two joint states", time[1:], 1e3 * np.diff(time), points=True)
    plot = Plot("Time between joint states", "time [s]", "difference of stamps [ms]", (curve,))
    return Verdict(
        Cause.LOST_SAMPLES,
        State.FOUND if found else State.FINE,
        text,
        value=share,
        limit=_LARGEST,
        cure=_CURE if found else "",
        plots=(plot,),
    )
