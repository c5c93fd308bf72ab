"""What a value of a range changes about a run of the second edition, around a class of hardware."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value, as_float, joint_array
from pidtsm_core.robots import find_robot
from pidtsm_studies.score.criteria import Range
from pidtsm_studies.score.tasks import Task

FASTEST = "fastest"
"""The range whose values are speeds of the motion, see `Motion.at`."""
_BRISTLES = 1000.0
"""Stiffness of what sticks, N m/rad per N m of the effort limit."""
_DAMPING = 0.1
"""Damping of an elastic gear, N m s/rad per N m, as in the classes."""
_MODEL, _NOISE = 0.1, 1e-5
"""Errors of masses and inertias (share), and noise of the position (rad), where everything is as bad as the class."""
_PROPORTIONAL = (
    "actuator.lag",
    "actuator.resolution",
    "backlash.gap",
    "effort_sensor.noise",
    "friction.coulomb",
    "friction.static",
    "friction.load",
    "friction.asymmetry",
    "friction.cold",
    "friction.cogging",
)
"""Parameters that a scaled class has so many times."""
_INVERSE = ("elasticity.stiffness", "actuator.frequency")
"""Parameters that it has divided by so much; at 0 they are off."""
_FINEST = 40
"""Largest number of bits of an encoder."""


def changes(
    each: Range, value: float, seed: int, task: Task, limits: Array, simulator: Mapping[str, Value]
) -> dict[str, Any]:
    """Parameters of the simulator that differ from those of the class.

    Args:
        each: the range.
        value: one of its values.
        seed: of what is random.
        task: of the arm.
        limits: effort limits, N m, shape (joints,).
        simulator: every parameter of the simulator on the class.
    """
    rigid = _rigid(simulator, limits.size)
    if each.relative_to == FASTEST:
        found: dict[str, Any] = {}
    elif each.relative_to == "class":
        found = scaled(simulator, value)
    elif each.relative_to == "rate":
        found = {name: round(value * as_float(simulator["rate"])) for name in each.parameters}
    elif each.relative_to == "twist":
        stiffness = np.where(rigid, 0.0, limits / value) if value else np.zeros(limits.size)
        found = {"elasticity.stiffness": stiffness.tolist(), "elasticity.damping": (_DAMPING * limits).tolist()}
    elif each.relative_to == "sticking":
        coulomb = joint_array(simulator["friction.coulomb"], limits.size)
        found = {
            "friction.static": (coulomb + value * limits).tolist(),
            "friction.bristle_stiffness": (_BRISTLES * limits).tolist(),
        }
    else:
        return each.settings(value, seed, task, limits)
    return {**found, "seed": seed}


def scaled(simulator: Mapping[str, Value], factor: float) -> dict[str, Any]:
    """The imperfections of a class so many times, with errors of the model and noise; 0: ideal hardware at its rate."""
    found: dict[str, Any] = {name: _times(simulator[name], factor) for name in _PROPORTIONAL}
    found |= {name: _times(simulator[name], 1.0 / factor if factor else 0.0) for name in _INVERSE}
    bits = np.asarray(simulator["encoder.bits"])
    coarser = np.round(bits - math.log2(factor)) if factor else np.zeros_like(bits)
    return {
        **found,
        "encoder.bits": np.clip(coarser, 0, _FINEST).astype(int).tolist(),
        "delay.samples": round(as_float(simulator["delay.samples"]) * factor),
        "model_error.mass": _MODEL * factor,
        "model_error.inertia": _MODEL * factor,
        "noise.std": _NOISE * factor,
    }


def _times(value: Value, factor: float) -> Any:
    return (np.asarray(value, dtype=np.float64) * factor).tolist()


def _rigid(simulator: Mapping[str, Value], joints: int) -> Array:
    """Which joints cannot be elastic: those that slide, and those without a rotor, shape (joints,)."""
    robot = find_robot(simulator)
    slides = np.array(robot.slides) if robot.slides else np.zeros(joints, dtype=bool)
    return np.asarray(slides | (robot.rotors(robot.pack_model(simulator)) <= 0.0))
