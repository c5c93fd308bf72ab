"""Masses that MuJoCo's compiler refuses: read beside it, because many of them cannot matter.

The inertia of a link that does not move, or is fixed to a heavier one, may be impossible without any effect. So the
compiler gets another one, and what moves together is judged as a whole, see `possible`: a body has masses at places, so
its second moments of mass are not negative (Wensing, Kim and Slotine, IEEE RA-L 2018).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.compiler import compile_spec, load_mujoco
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.tree.layout import steiner

ROUNDING = 0.02
"""Share of the largest inertia by which published figures, which are rounded, may miss what a body can have."""
_LEAST = 1e-6
"""Smallest second moment of mass, relative to the largest one, for MuJoCo's own check."""


class Inertial(NamedTuple):
    """Mass of a link.

    Attributes:
        mass: kg.
        center: centre of mass in the frame of the link, shape (3,), m.
        inertia: about the centre of mass in the axes of the link, shape (3, 3), kg m^2.
    """

    mass: float
    center: Array
    inertia: Array


def lack(inertia: Array) -> float:
    """How far an inertia about the centre of mass, shape (3, 3), kg m^2, is from that of a body.

    Returns:
        Share of its largest principal inertia by which the others are too small; at most 0 for a body's.
    """
    principal = np.linalg.eigvalsh(inertia)
    largest = float(np.abs(principal).max())
    missing = max(-float(principal[0]), float(principal[2] - principal[0] - principal[1]))
    return missing / largest if largest > 0.0 else 0.0


def possible(inertia: Array, mass: float, moment: Array, what: str) -> Array:
    """The inertia of a body next to one that rounding made impossible.

    Args:
        inertia: about any point, shape (3, 3), kg m^2.
        mass: kg, positive.
        moment: mass times centre of mass from that point, shape (3,), kg m.
        what: the link, with which the message begins.

    Returns:
        About the same point, shape (3, 3), kg m^2; a possible one is not changed.

    Raises:
        DescriptionError: it is not near that of any body, or zero.
    """
    displaced = mass * steiner(moment / mass)
    principal, axes = np.linalg.eigh(inertia - displaced)
    if not principal.any():
        raise DescriptionError(f"{what}: it has a mass, but no inertia; compute its inertia from its shape")
    if lack(inertia - displaced) <= 0.0:
        return inertia
    if lack(inertia - displaced) > ROUNDING:
        numbers = ", ".join(f"{value:.3g}" for value in principal)
        raise DescriptionError(
            f"{what}: no body has its inertia: the principal inertias are {numbers} kg m^2, and none may be negative, "
            "or larger than the sum of the others; correct the figures or their units, or compute them from the shape"
        )
    # Second moments of mass along the principal axes, which cannot be negative.
    moments = 0.5 * principal.sum() - principal
    moments = np.maximum(moments, _LEAST * moments.max())
    return np.asarray(axes @ np.diag(moments.sum() - moments) @ axes.T + displaced)


def compile_bodies(spec: Any) -> tuple[Any, Mapping[int, Inertial]]:
    """The ``mujoco.MjModel`` of a ``mujoco.MjSpec``, which is changed if MuJoCo would refuse masses.

    Returns:
        The model, and the inertials that it does not have, by body.

    Raises:
        DescriptionError: it cannot be compiled for another reason; see `compile_spec`.
    """
    refused = [(body, _inertial(body)) for body in spec.bodies[1:] if _is_impossible(body)]
    for body, _ in refused:
        _make_possible(body)
    try:
        return compile_spec(spec), {body.id: inertial for body, inertial in refused}
    except DescriptionError:
        least = float(load_mujoco().mjMINVAL)
        if spec.compiler.boundmass >= least:
            raise
    spec.compiler.boundmass = spec.compiler.boundinertia = 2.0 * least
    model = compile_spec(spec)
    nothing = Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    empty = {i: nothing for i in range(1, model.nbody) if model.body_mass[i] <= 2.0 * least}
    return model, empty | {body.id: inertial for body, inertial in refused}


def body_inertials(spec: Any) -> list[Inertial]:
    """Inertials of each body of a ``mujoco.MjSpec`` but the first, the world; see `compile_bodies`, which changes it.

    Raises:
        DescriptionError: it cannot be compiled.
    """
    model, missing = compile_bodies(spec)
    return [missing[body] if body in missing else _compiled(model, body) for body in range(1, model.nbody)]


def _compiled(model: Any, body: int) -> Inertial:
    """Inertial of a body of a ``mujoco.MjModel``."""
    axes = np.empty(9)
    load_mujoco().mju_quat2Mat(axes, model.body_iquat[body])
    turned = axes.reshape(3, 3)
    inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
    return Inertial(float(model.body_mass[body]), np.array(model.body_ipos[body]), inertia)


def _is_impossible(body: Any) -> bool:
    """Whether MuJoCo refuses the inertia of a body."""
    if not body.explicitinertial:
        return False
    inertia = _inertia(body)
    return lack(inertia) > 0.0 or float(np.linalg.eigvalsh(inertia)[0]) <= 0.0


def _inertia(body: Any) -> Array:
    """Inertia about the centre of mass in the axes of the inertial frame, shape (3, 3), kg m^2."""
    if np.isnan(body.fullinertia[0]):
        return np.diag(body.inertia)
    xx, yy, zz, xy, xz, yz = body.fullinertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _inertial(body: Any) -> Inertial:
    axes = np.empty(9)
    load_mujoco().mju_quat2Mat(axes, body.iquat)
    turned = axes.reshape(3, 3)
    return Inertial(float(body.mass), np.array(body.ipos), turned @ _inertia(body) @ turned.T)


def _make_possible(body: Any) -> None:
    """Give a body the inertia of a ball."""
    body.inertia = np.full(3, max(float(np.abs(_inertia(body)).max()), 1e-9))
    body.fullinertia = np.full(6, np.nan)
