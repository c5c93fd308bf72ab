"""The ten inertial parameters of a body as a matrix, which is positive definite exactly if a body can have them."""

import numpy as np

from pidtsm_core.arrays import Array


def pseudo_inertia(link: Array) -> Array:
    """Pseudo-inertia of ten parameters, shape (4, 4): positive definite exactly if a body can have them.

    J = ((S, h), (h', m)) with S = tr(I) / 2 - I; Wensing, Kim and Slotine, IEEE RA-L 3 (2018).
    """
    mass, moment = link[0], link[1:4]
    xx, yy, zz, xy, xz, yz = link[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    spread = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return np.block([[spread, moment[:, np.newaxis]], [moment, np.array(mass)]])


def link_parameters(pseudo: Array) -> Array:
    """The inverse of `pseudo_inertia`, shape (..., 10), linear in pseudo, shape (..., 4, 4)."""
    spread = pseudo[..., :3, :3]
    inertia = np.trace(spread, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis] * np.eye(3) - spread
    moments = inertia[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return np.concatenate([pseudo[..., 3:, 3], pseudo[..., :3, 3], moments], axis=-1)


def is_consistent(link: Array) -> bool:
    """Whether a body with positive mass can have these parameters, shape (10,)."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0)


def moved(link: Array, placement: Array) -> Array:
    """Ten parameters in another frame; `placement`, shape (3, 4), leads from the old one to the new one."""
    transform = np.vstack([placement, [0.0, 0.0, 0.0, 1.0]])
    return link_parameters(transform @ pseudo_inertia(link) @ transform.T)
