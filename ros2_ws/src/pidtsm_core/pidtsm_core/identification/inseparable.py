"""What no motion can tell apart although descriptions have it: mass, armature and offset of joints that slide."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.unit_forces import LINK

_ALIKE = 1e-6
"""Share by which the effort of gravity may differ from a constant one, in m/s^2."""


def weights(arm: Description) -> Array:
    """Effort of gravity on joints that slide, for each kilogram of each link, if no posture changes it.

    Args:
        arm: the arm.

    Returns:
        m/s^2, shape (joints, joints): joint, link; nan where a posture changes it. Joints that turn have zeros.
    """
    joints = len(arm.joints)
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (20, joints))
    masses = np.arange(joints) * LINK
    columns = regressor(arm.tree, q, 0.0 * q, 0.0 * q)[..., masses]
    constant = np.ptp(columns, axis=0) < _ALIKE
    result = np.where(constant, columns[0], np.nan)
    result[~arm.slides] = 0.0
    return np.where(np.abs(result) < _ALIKE, 0.0, result)


def like_gravity(arm: Description) -> Array:
    """Whether a constant effort on a joint looks as the weight of what it lifts, shape (joints,)."""
    found = weights(arm)
    return np.asarray(np.nan_to_num(found).any(axis=1) & ~np.isnan(found).any(axis=1))


def inseparable(arm: Description, parameters: Array) -> tuple[str, ...]:
    """A sentence for each joint that slides: what is only known together, and how it is divided.

    Args:
        arm: its description.
        parameters: identified pi, see `regressor`, shape (14 joints,).
    """
    joints = len(arm.joints)
    mass = parameters[: LINK * joints : LINK]
    armature, _, _, offset = parameters[LINK * joints :].reshape(4, joints)
    q = np.zeros((1, joints))
    sentences = []
    for j in np.flatnonzero(arm.slides):
        push = q.copy()
        push[0, j] = 1.0
        at_rest, pushed = (regressor(arm.tree, q, q, ddq)[0, j, : LINK * joints : LINK] for ddq in (q, push))
        moved = float((pushed - at_rest) @ mass)
        text = f"{arm.joints[j]}: no motion tells the mass that it moves ({moved:.4g} kg) from its armature "
        text += f"({armature[j]:.4g} kg); acceleration shows their sum, {moved + armature[j]:.4g} kg"
        if like_gravity(arm)[j]:
            weight = float(weights(arm)[j] @ mass)
            text = (
                f"{arm.joints[j]}: no motion tells mass, armature and offset apart: acceleration shows mass + armature "
            )
            text += f"= {moved:.4g} + {armature[j]:.4g} kg, gravity weight + offset = {weight:.4g} + {offset[j]:.4g} N"
        sentences.append(f"{text}; the sum is right as written")
    return tuple(sentences)
