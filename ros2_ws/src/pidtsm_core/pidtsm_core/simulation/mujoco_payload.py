"""The payload in a scene: a box at the tool while it is carried, and a box that falls when it is dropped.

Both are always part of the model, so that its structure does not change; only one is there at a time. The box that
falls does not touch the arm that drops it.
"""

from collections.abc import Iterable
from enum import IntEnum
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.compiler import load_mujoco
from pidtsm_core.robots.rigid_bodies import set_inertial

DROPPED = "pidtsm_dropped_payload"
"""Name of the body that falls."""
_DENSITY = 1000.0
"""Density of the box, kg/m^3."""
_COLOR = 0.9, 0.6, 0.2
_LIGHTEST = 1e-3
"""kg; mass of the box that falls if there is no payload."""


class Phase(IntEnum):
    """Where the payload is."""

    ABSENT = 0
    CARRIED = 1
    DROPPED = 2


def add_boxes(spec: Any, carried: str, arm: Iterable[str], payload: tuple[float, Array, Array]) -> None:
    """Add both boxes to a scene.

    Args:
        spec: the scene, of type ``mujoco.MjSpec``.
        carried: name of the body of the payload at the tool.
        arm: names of the arm's bodies.
        payload: mass (kg), centre of mass, shape (3,), m, and inertia about it, shape (3, 3), kg m^2.
    """
    mass, center, inertia = payload
    mass = max(mass, _LIGHTEST)
    side = (mass / _DENSITY) ** (1.0 / 3.0)
    body = spec.worldbody.add_body(name=DROPPED, gravcomp=1.0)
    body.add_freejoint(name=DROPPED)
    set_inertial(body, mass, center, inertia if np.any(inertia) else mass * side**2 / 6.0 * np.eye(3))
    for parent in (spec.body(carried), body):
        box = load_mujoco().mjtGeom.mjGEOM_BOX
        parent.add_geom(name=parent.name, type=box, size=[0.5 * side] * 3, pos=center, mass=0.0)
    for name in arm:
        spec.add_exclude(bodyname1=name, bodyname2=DROPPED)


def show_box(spec: Any, carried: str, phase: Phase) -> None:
    """Let the box of this phase be seen and touch the scene, and the other one not; arguments as above.

    Without a payload, i.e. with the least mass, there is no box.
    """
    exists = spec.body(DROPPED).mass > _LIGHTEST
    for name, its_phase in ((carried, Phase.CARRIED), (DROPPED, Phase.DROPPED)):
        box, present = spec.geom(name), exists and phase == its_phase
        box.rgba = [*_COLOR, float(present)]
        box.contype, box.conaffinity = int(present), int(present and name == DROPPED)


def release_box(model: Any, phase: Phase) -> None:
    """Let gravity act on the box that is dropped, in a ``mujoco.MjModel``; before, it floats."""
    model.body_gravcomp[model.body(DROPPED).id] = float(phase != Phase.DROPPED)
