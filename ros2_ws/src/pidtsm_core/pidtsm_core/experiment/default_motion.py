"""A motion for any arm, for scenarios that the user need not write."""

import math
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Robot

DURATION = 10.0
"""s."""
_LARGEST, _SHARE = 0.3, 0.3
"""Largest amplitude (rad or m), and largest share of half the range of a joint."""
_SPEED = 0.3
"""Largest share of the velocity limit."""
_LONG, _POSTURES = 100.0, 400
"""Time (s) and postures in which it is judged whether a joint can carry the arm."""
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


def largest_holding_effort(robot: Robot, model: Array) -> Array:
    """Largest effort that holds an arm anywhere on its default motion, shape (joints,), N m or N.

    Args:
        robot: the arm.
        model: its packed parameters with what it carries, shape (n,).
    """
    motion = default_motion(robot)["trajectory"]
    middle, amplitude, frequency = (
        np.array(motion[f"reference.{key}"]) for key in ("offset", "amplitude", "frequency")
    )
    rest, largest = np.zeros(middle.size), np.zeros(middle.size)
    for time in np.linspace(0.0, _LONG, _POSTURES):
        effort = np.zeros((1, middle.size))
        q = middle - amplitude * np.cos(2.0 * math.pi * frequency * time)
        robot.dynamics.inverse_dynamics(q, rest, rest[np.newaxis], model, effort)
        largest = np.maximum(largest, np.abs(effort[0]))
    return largest
