"""Noise is told from motion that is fast where samples are lost."""

import numpy as np
import pytest

from pidtsm_studies.diagnosis.detectors.noise import noisy_encoder
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.observed import Observed


@pytest.mark.parametrize(("noise", "lost"), [(0.0, 0.05), (4e-4, 0.05), (4e-4, 0.0), (0.0, 0.0)])
def test_only_noise_counts_as_noise_however_violent_the_motion_is_and_whatever_is_lost(
    noise: float, lost: float
) -> None:
    random = np.random.default_rng(3)
    time = 0.001 * np.arange(10_000)
    position = 0.1 * np.sin(2.0 * np.pi * 6.0 * time) + noise * random.standard_normal(time.size)
    starts = random.random(time.size) < lost / 4.0
    kept = ~np.convolve(starts, np.ones(4, dtype=bool))[: time.size].astype(bool)
    measured = position[kept, np.newaxis]
    found = noisy_encoder(Loop(Observed(("joint",), time[kept], measured, np.ones_like(measured))))
    assert found.found == (noise > 0.0), found.text
    if noise:
        assert found.value == pytest.approx(noise, rel=0.25)
