"""What is learnt from the observer survives measurements that cannot be, and knows how noisy they are."""

import numpy as np
import pytest
from support.coreloop import CoreLoop

from pidtsm_core.control.state import Noise
from pidtsm_core.experiment import ADAPTS


@pytest.mark.parametrize("absurd", [1e3, 1e30, 1e160, 1e300, -1.7e308])
def test_an_absurd_measurement_leaves_nothing_that_is_not_finite(absurd: float) -> None:
    loop = CoreLoop("panda", {**ADAPTS, "plausibility.velocity": 0.0}, {"encoder.bits": 14})
    loop.advance(300)
    controller = loop.controller
    stamp = loop.sample * 1_000_000
    controller.position[2] = absurd
    controller.step(stamp, stamp)
    loop.sample += 1
    efforts = loop.advance(300)
    assert np.isfinite(efforts).all()
    learnt = controller.state
    for array in (learnt.noise, learnt.learnt_velocity, learnt.friction, learnt.friction_evidence, learnt.softness):
        assert np.isfinite(array).all()
    assert np.isfinite(learnt.lateness).all()
    assert all(np.isfinite(array).all() for array in learnt.bank)


@pytest.mark.parametrize("std", [1e-4, 1e-3])
def test_the_noise_of_the_position_is_known(std: float) -> None:
    loop = CoreLoop("panda", ADAPTS, {"noise.std": std})
    loop.advance(3_000)
    assert np.sqrt(loop.controller.state.noise[Noise.VARIANCE]) == pytest.approx(0.92 * std, rel=0.15)
