"""A motion for any arm, for scenarios that the user need not write."""

import math
from typing import Any

import numpy as np

from pidtsm_core.robots import Robot

DURATION = 10.0
"""s."""
_LARGEST, _SHARE = 0.3, 0.3
"""Largest amplitude (rad or m), and largest share of half the range of a joint."""
_SPEED = 0.3
"""Largest share of the velocity limit."""
_FREQUENCY, _SPREAD = 0.1, 0.2
"""Hz of the first joint; relative difference of the last one, so that the joints pass through many postures."""


def default_motion(robot: Robot) -> dict[str, dict[str, Any]]:
    """Settings with which every joint swings about its middle, from rest, within its limits of position and velocity.

    Args:
        robot: the arm; the middle of its joints is its default start position.

    Returns:
        Settings by node.
    """
    joints = len(robot.joints)
    middle = np.array(robot.initial_position)
    frequency = _FREQUENCY * (1.0 + _SPREAD * np.arange(joints) / joints)
    amplitude = np.full(joints, _LARGEST)
    if robot.position_limits:
        lower, upper = np.array(robot.position_limits).T
        amplitude = np.minimum(amplitude, _SHARE * (0.5 * (upper - lower)))
    if robot.velocity_limit:
        amplitude = np.minimum(amplitude, _SPEED * np.array(robot.velocity_limit) / (2.0 * math.pi * frequency))
    return {
        "simulator": {"initial_position": (middle - amplitude).tolist()},
        "controller": {},
        "trajectory": {
            "reference.name": "sines",
            "reference.amplitude": amplitude.tolist(),
            "reference.frequency": frequency.tolist(),
            "reference.phase": -0.5 * math.pi,
            "reference.offset": middle.tolist(),
        },
    }
