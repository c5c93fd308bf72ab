"""What the bodies of an arm feel where they touch something, on the engine MuJoCo."""

from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.compiler import load_mujoco
from pidtsm_core.simulation.mujoco_model import MujocoModels


def bodies_that_can_touch(models: MujocoModels) -> tuple[str, ...]:
    """Names of the arm's bodies that have a shape which collides with others."""
    model = models.empty
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    found = set(model.geom_bodyid[collides].tolist())
    return tuple(dict.fromkeys(name for body, name in models.bodies.items() if body in found))


def contact_wrenches(models: MujocoModels, data: Any) -> dict[str, Array]:
    """The wrench of all contacts on each body of the arm that touches something.

    Args:
        models: the arm.
        data: of type ``mujoco.MjData``, after a step.

    Returns:
        By name of the body: force (N) and torque (N m) about the origin of its frame, in the axes of its frame, shape
        (6,); the wrenches are those during the last step of MuJoCo.
    """
    wrenches: dict[str, Array] = {}
    if data.ncon == 0:
        return wrenches
    force, mujoco = np.zeros(6), load_mujoco()
    for i in range(data.ncon):
        contact = data.contact[i]
        if contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(models.empty, data, i, force)
        axes = contact.frame.reshape(3, 3)
        # MuJoCo gives what the first geometry does to the second.
        for geom, sign in zip(contact.geom, (-1.0, 1.0), strict=True):
            body = int(models.empty.geom_bodyid[geom])
            if body not in models.bodies:
                continue
            linear, angular = sign * axes.T @ force[:3], sign * axes.T @ force[3:]
            angular += np.cross(contact.pos - data.xpos[body], linear)
            to_body = data.xmat[body].reshape(3, 3).T
            wrench = np.concatenate([to_body @ linear, to_body @ angular])
            name = models.bodies[body]
            wrenches[name] = wrenches[name] + wrench if name in wrenches else wrench
    return wrenches
