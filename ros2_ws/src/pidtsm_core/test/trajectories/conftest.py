"""Limits of arms, and what all tests of motions measure."""

import pytest
from support.testarms import Arm

from pidtsm_core.trajectories.limits import MotionLimits, motion_limits


@pytest.fixture(scope="module")
def limits(arm: Arm) -> MotionLimits:
    """The limits of each arm."""
    return motion_limits(arm.settings)


@pytest.fixture(scope="module")
def unlimited() -> MotionLimits:
    """Two joints of which nothing is known."""
    return motion_limits({"joints": ("joint1", "joint2")})
