"""An MJCF with other bodies."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.identification.carriers import corrected_links, mass_and_center
from pidtsm_core.robots import Description
from pidtsm_core.robots.compiler import compile_spec, load_mujoco, parse
from pidtsm_core.robots.inertials import Inertial, body_inertials
from pidtsm_core.robots.rigid_bodies import set_inertial
from pidtsm_core.robots.tree.unit_forces import LINK


def corrected_mjcf(arm: Description, parameters: Array) -> str:
    """The text of the MJCF with other parameters.

    Every body has an ``inertial``, also one whose geometry defined it before. Friction becomes ``damping`` and
    ``frictionloss`` of the joint, next to ``armature``. Files are named by their absolute paths.

    Args:
        arm: described by an MJCF.
        parameters: pi, see `regressor`, shape (14 joints,); offsets do not count.
    """
    spec = parse(arm.text).spec
    inertials = body_inertials(parse(arm.text).spec)
    for link, parameters_of_link in corrected_links(arm, parameters):
        inertials[link - 1] = Inertial(*mass_and_center(parameters_of_link))
    for body, inertial in zip(spec.bodies[1:], inertials, strict=True):
        set_inertial(body, *inertial)
    # Otherwise geometry or a total mass would override them.
    spec.compiler.inertiafromgeom = load_mujoco().mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.compiler.settotalmass = -1.0
    armature, viscous, coulomb, _ = parameters[LINK * len(arm.joints) :].reshape(4, len(arm.joints))
    for j, name in enumerate(arm.joints):
        joint = spec.joint(name)
        joint.armature, joint.frictionloss = armature[j], coulomb[j]
        # Of the powers of the velocity, the first alone.
        joint.damping = np.eye(1, np.size(joint.damping))[0] * viscous[j]
    compile_spec(spec)
    return str(spec.to_xml())
