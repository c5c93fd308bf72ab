"""What an identification writes, and whether it reproduces what the identification reports."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control.parameters import controller_schema
from pidtsm_core.identification.corrected_mjcf import corrected_mjcf
from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.identification import Identification
from pidtsm_core.identification.measurement import Motion
from pidtsm_core.identification.regressor import OF_JOINT
from pidtsm_core.parameters import Value, joint_array, resolve
from pidtsm_core.robots import DESCRIPTION, Description, find_robot, inverse_dynamics, make_model
from pidtsm_core.robots.tree.unit_forces import LINK

_SAME = 0.01
"""Share of the reported error by which that of the written files may differ."""
_NOTHING = 1e-6
"""Share of the torque that does not count: written numbers have nine digits."""


def corrected_description(arm: Description, parameters: Array) -> str:
    """The text of the description, a URDF or an MJCF as before, with other parameters.

    Args:
        arm: its description.
        parameters: pi, see `regressor`, shape (14 joints,); offsets do not count.
    """
    return (corrected_urdf if arm.is_urdf else corrected_mjcf)(arm, parameters)


def written_parameters(found: Identification, description: str) -> dict[str, dict[str, Value]]:
    """Parameters of controller and simulator with which they use the identified arm, by node and name.

    Args:
        found: the result.
        description: path or text of the corrected description.
    """
    joints = len(found.arm.joints)
    armature, viscous, coulomb, offset = (
        tuple(each.tolist()) for each in found.parameters[LINK * joints :].reshape(len(OF_JOINT), joints)
    )
    common: dict[str, Value] = {"joints": found.arm.joints, DESCRIPTION.name: description, "robot.armature": armature}
    resistance = {"coulomb": coulomb, "viscous": viscous, "offset": offset}
    return {
        "controller": {**common, **{f"compensation.{name}": value for name, value in resistance.items()}},
        "simulator": {**common, **{f"friction.{name}": value for name, value in resistance.items()}},
    }


def judged_as_written(found: Identification, settings: Mapping[str, Any]) -> Identification:
    """The result with the errors of what was written, read back, on the data kept apart.

    Where they differ from the reported ones by more than 1 %, a warning names the joint and the difference.

    Args:
        found: the result.
        settings: parameters of the controller, as read from the file that was written.

    Raises:
        ParameterError, DescriptionError: the controller refuses what was written.
    """
    check = found.check
    errors, reported = check.error(_efforts(settings, check.motion)), check.error(check.after)
    size = np.sqrt(np.mean(check.measured**2, axis=0))
    warnings = tuple(
        f"what is written does not reproduce the result: it leaves {error:.3g} {unit} of {joint} unexplained on data "
        f"kept apart, instead of {before:.3g} {unit}"
        for joint, unit, error, before, scale in zip(found.arm.joints, found.units, errors, reported, size, strict=True)
        if not abs(error - before) <= _SAME * before + _NOTHING * scale
    )
    return replace(found, as_written=errors, warnings=(*found.warnings, *warnings))


def _efforts(settings: Mapping[str, Any], motion: Motion) -> Array:
    """Efforts that the controller with these parameters feeds forward along a motion, shape (samples, joints)."""
    joints = motion.position.shape[1]
    values = resolve(controller_schema, settings, joints)
    robot = find_robot(values)
    model = make_model(robot, robot.pack_model(values))
    efforts, one = np.empty(motion.position.shape), np.empty((1, joints))
    states = (np.ascontiguousarray(each) for each in (motion.position, motion.velocity, motion.acceleration))
    for sample, (q, dq, ddq) in enumerate(zip(*states, strict=True)):
        inverse_dynamics(model, q, dq, ddq[np.newaxis], one)
        efforts[sample] = one[0]
    coulomb, viscous, offset = (
        joint_array(values[f"compensation.{name}"], joints) for name in ("coulomb", "viscous", "offset")
    )
    return np.asarray(efforts + coulomb * motion.coulomb + viscous * motion.velocity + offset)
