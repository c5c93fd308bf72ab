"""A noisy encoder, from the spectrum of its position above everything that an arm can do.

No arm moves at more than a quarter of the sampling rate: there, the spectrum is that of the encoder. White noise with
standard deviation s has the density 2 s^2 / rate. Its median over the frequencies leaves out narrow peaks, such as
those of a loop that rings. Where samples are lost, fast motion between their neighbours looks like noise; there, the
fourth difference of positions without gaps, to which white noise contributes 70 s^2, tells it. The smaller one counts.
Rounding to steps is not noise: an encoder may scatter by a step.
"""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict

_LARGEST = 1.5e-4
"""rad or m; standard deviation that needs no mention."""
_STEPS = 0.8
"""Noise of an encoder with coarse steps that needs no mention, in steps."""
_ORDER, _GAIN, _OF_MEDIAN = 4, 70.0, 0.6745
"""Of the difference, factor of its variance to that of white noise, and median of a Gaussian number's size."""


def noisy_encoder(loop: Loop) -> Verdict:
    """Compare the noise of each joint with its resolution."""
    spectrum = loop.spectrum
    top = spectrum.frequency > 0.25 * loop.rate
    noise = np.sqrt(np.median(spectrum.position[top], axis=0) * 0.5 * loop.rate)
    noise = np.minimum(noise, _between_gaps(loop))
    steps = np.array([resolution(column) for column in loop.observed.position.T])
    limit = np.maximum(_LARGEST, _STEPS * steps)
    order = np.argsort(-noise / limit)
    noisy = [int(j) for j in order if noise[j] > limit[j]]
    worst = int(order[0])
    unit = loop.observed.units[worst].position
    each = f"the position of {loop.joints[worst]} has noise of {1e3 * noise[worst]:.2g} m{unit}"
    step = f", its steps are {1e3 * steps[worst]:.2g} m{unit}" if steps[worst] else ""
    curves = tuple(
        Curve(loop.joints[j], spectrum.frequency[1:], np.sqrt(spectrum.position[1:, j])) for j in (noisy or [worst])[:3]
    )
    return Verdict(
        Cause.NOISY_ENCODER,
        State.FOUND if noisy else State.FINE,
        each + step,
        tuple(loop.joints[j] for j in noisy),
        float(noise[worst]),
        float(limit[worst]),
        unit,
        "check cable and shield of the encoder; until then, lower the bandwidth: ./pidtsm gains --robot ROBOT "
        f"--encoder-bits {int(np.log2(2.0 * np.pi / (3.0 * noise[worst])))}"
        if noisy
        else "",
        (Plot("Spectrum of the position", "frequency [Hz]", f"{unit}/√Hz", curves, logarithmic=True),),
    )


def _between_gaps(loop: Loop) -> Array:
    """Standard deviation of the noise, from positions between which none is lost, shape (joints,), rad or m."""
    observed = loop.observed
    steady = np.diff(observed.time) < 1.5 * loop.period
    whole = np.lib.stride_tricks.sliding_window_view(steady, _ORDER).all(axis=1)
    differences = np.diff(observed.position, _ORDER, axis=0)[whole]
    if not len(differences):
        return np.full(len(loop.joints), np.inf)
    return np.asarray(np.median(np.abs(differences), axis=0) / (_OF_MEDIAN * np.sqrt(_GAIN)))


def resolution(position: Array) -> float:
    """Step of an encoder (rad or m), the difference that all its values are multiples of; 0: none is seen.

    The positions have shape (samples,).
    """
    values = np.unique(position[np.isfinite(position)])
    differences = np.diff(values)
    differences = differences[differences > 1e-9]
    if differences.size < 10:
        return 0.0
    step = float(np.percentile(differences, 5.0))
    multiples = differences / step
    return step if np.mean(np.abs(multiples - np.round(multiples)) < 0.05) > 0.95 else 0.0
