"""Elastic joints on the engine MuJoCo: each motor is a body of its own.

A tendon with stiffness and damping couples it to its link, so that both move as in `drivetrain_step`.

MuJoCo integrates springs explicitly; its steps are so short that it can.
"""

import math
from typing import Any

import numpy as np

from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots.compiler import load_mujoco
from pidtsm_core.robots.rigid_bodies import set_inertial
from pidtsm_core.simulation.drivetrain import STIFFNESS, Drivetrain

_MOTOR = "pidtsm_motor_"
"""What precedes the names of motors and their tendons."""
_LEAST = 1e-9
"""Mass and inertia of the body of a motor, kg and kg m^2; its rotor is the armature of its joint."""
_ANGLE = 0.5
"""rad; largest angle by which a joint may vibrate in a step of MuJoCo."""
_MOST_STEPS = 500
"""Largest number of steps in a period."""


def motor_name(joint: int) -> str:
    """Name of the motor of a joint with this index."""
    return f"{_MOTOR}{joint}"


def add_motors(spec: Any, joints: list[str], drives: Drivetrain) -> None:
    """Add the motors of elastic joints.

    Args:
        spec: the arm, of type ``mujoco.MjSpec``.
        joints: names of its joints in it.
        drives: their parameters.
    """
    mujoco = load_mujoco()
    for j in np.flatnonzero(drives.stiffness > 0.0):
        name = motor_name(int(j))
        body = spec.worldbody.add_body(name=name, gravcomp=1.0)
        set_inertial(body, _LEAST, np.zeros(3), _LEAST * np.eye(3))
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], armature=drives.rotor[j] - _LEAST)
        stiffness, damping = ([float(each[j]), 0.0, 0.0] for each in (drives.stiffness, drives.damping))
        tendon = spec.add_tendon(name=name, stiffness=stiffness, damping=damping, springlength=[0, 0])
        tendon.wrap_joint(name, 1.0)
        tendon.wrap_joint(joints[j], -1.0)


def steps_for(drives: Drivetrain, period: float) -> int:
    """Steps of MuJoCo in a period (s) that its explicit springs and bristles need.

    Raises:
        ParameterError: they are too many.
    """
    steps = math.ceil(drives.fastest * period / _ANGLE)
    if steps > _MOST_STEPS:
        raise ParameterError(
            f"{STIFFNESS.name}: a joint vibrates with {drives.fastest:.3g} rad/s, which takes {steps} steps of MuJoCo "
            f"in a period, more than {_MOST_STEPS}; lower the stiffness or the stiffness of its friction, or choose "
            "the engine rigid_body",
            STIFFNESS.name,
        )
    return max(steps, 1)
