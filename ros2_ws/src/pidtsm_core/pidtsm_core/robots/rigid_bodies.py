"""An arm as the bodies of MuJoCo: joints that do not move are welded, masses may differ, a payload is at the tool."""

from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.compiler import load_mujoco, parse
from pidtsm_core.robots.description import Description, joint_displacement, rotation_of
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.inertials import compile_bodies
from pidtsm_core.robots.tree.layout import Column, inertia_matrix, rows, steiner

PAYLOAD = "pidtsm_payload"
"""Name of the body of the payload, which is part of the tool."""
PICTURE = 1280, 720
"""Width and height of a picture, pixels."""
_BONE = 0.06
"""Radius of a line of a skeleton, as a share of the longest one."""
TOOL = "pidtsm_tool"
"""Name of the site at the tool."""


def described_bodies(arm: Description, length: float = 1.0, tree: Array | None = None, touchable: bool = False) -> Any:
    """The bodies of a description.

    Args:
        arm: the description.
        length: factor of the distances of joints and centres of mass.
        tree: masses and inertias, as `TreeRobot.pack_model` returns them, shape (size(joints),); None: those of the
            description.
        touchable: keep the geometry of a URDF, which touches other things than the arm itself. An MJCF always has its
            own.

    Returns:
        Of type ``mujoco.MjSpec``, with the joints of the arm alone, without actuators, and with an empty payload.

    Raises:
        DescriptionError: a link has both a joint of the arm and a locked one.
    """
    spec = parse(arm.text, geometry=touchable).spec
    if touchable and arm.is_urdf:
        for geom in spec.geoms:
            geom.conaffinity = 0
    model, inertials = compile_bodies(spec)
    if tree is None and inertials:
        tree = arm.tree
    links = [body for body in spec.bodies if body.id >= model.nbody - len(arm.links.names)]
    for body, name in zip(links, arm.links.names, strict=True):
        if body.id:
            body.name = name
    _remove_references(spec, bool(arm.locked))
    for body in spec.bodies[1:]:
        _place(spec, model, body, arm, length)
    if tree is not None:
        _set_masses(links, arm, length, tree)
    # The tool is where it is, however long the links are.
    add_payload(links[arm.tool_link], (1.0 - length) * arm.tool_rotation.T @ arm.tool)
    return spec


def text_bodies(text: str) -> Any:
    """The bodies of an MJCF all of whose joints are those of the arm, and whose last body is its tool, as above."""
    spec = parse(text).spec
    add_payload(spec.bodies[-1], np.zeros(3))
    return spec


def add_payload(tool: Any, place: Array) -> None:
    """Add an empty payload to a body of type ``mujoco.MjsBody``, at a place in it, shape (3,), m, and a site there."""
    tool.add_site(name=TOOL, pos=place)
    # With a body of its own, the structure of the model is the same with and without payload, and so is its state.
    tool.add_body(name=PAYLOAD, pos=place, explicitinertial=True, mass=0.0, inertia=np.zeros(3))


def add_skeleton(spec: Any) -> None:
    """Give an arm without shapes a line from each body to those behind it, in a ``mujoco.MjSpec``, for pictures."""
    spec.compiler.discardvisual = False
    if spec.geoms:
        return
    bodies = [(body, np.array(body.pos)) for body in spec.bodies[2:] if body.name != PAYLOAD]
    width = _BONE * max((float(np.linalg.norm(to)) for _, to in bodies), default=1.0)
    for body, to in bodies:
        if np.linalg.norm(to) > width:
            kind = load_mujoco().mjtGeom.mjGEOM_CAPSULE
            ends = [*np.zeros(3), *to]
            body.parent.add_geom(type=kind, fromto=ends, size=[width, 0.0, 0.0], contype=0, conaffinity=0)


def add_surroundings(spec: Any) -> None:
    """Add what pictures need to a ``mujoco.MjSpec``: a sky, light, and memory for pictures of `PICTURE` pixels."""
    mujoco = load_mujoco()
    kinds = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    if not any(texture.type == kinds[0] for texture in spec.textures):
        light, dark = [0.95, 0.97, 1.0], [0.55, 0.6, 0.7]
        spec.add_texture(type=kinds[0], builtin=kinds[1], rgb1=light, rgb2=dark, width=64, height=384)
    if not spec.lights:
        kind = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        spec.worldbody.add_light(type=kind, pos=[0.0, 0.0, 4.0], dir=[0.4, 0.6, -1.0], castshadow=False)
    spec.compiler.discardvisual = False
    sizes = spec.visual.global_
    sizes.offwidth, sizes.offheight = max(sizes.offwidth, PICTURE[0]), max(sizes.offheight, PICTURE[1])


def set_inertial(body: Any, mass: float, center: Array, inertia: Array) -> None:
    """Set the mass of a body.

    Args:
        body: of type ``mujoco.MjsBody``.
        mass: kg.
        center: centre of mass in the frame of the body, shape (3,), m.
        inertia: about the centre of mass in the axes of the body, shape (3, 3), kg m^2.
    """
    principal, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.linalg.det(axes)
    body.explicitinertial = True
    body.mass, body.ipos = mass, center
    body.inertia, body.iquat = np.maximum(principal, 0.0), _quaternion(axes)
    body.fullinertia = np.full(6, np.nan)


def _remove_references(spec: Any, locks: bool) -> None:
    """Remove what drives or measures the joints, and, if joints are locked, what couples them."""
    coupling = [e for e in spec.equalities if e.type.name == "mjEQ_JOINT"]
    for element in (*spec.actuators, *spec.sensors, *spec.keys, *(([*spec.tendons, *coupling]) if locks else ())):
        spec.delete(element)


def _place(spec: Any, model: Any, body: Any, arm: Description, length: float) -> None:
    """Weld the locked joints of a body, and scale its distances."""
    rotation, translation = rotation_of(model.body_quat[body.id]), length * model.body_pos[body.id]
    locked = [joint for joint in body.joints if joint.name in arm.locked]
    if not locked and length == 1.0:
        return
    if locked and len(locked) < len(body.joints):
        raise DescriptionError(f"link {body.name}: one of its joints is locked and another is not, which MuJoCo cannot")
    for joint in body.joints:
        joint.pos = length * model.jnt_pos[joint.id]
    for joint in locked:
        turn, shift = joint_displacement(model, joint.id, arm.locked[joint.name])
        translation = translation + length * (rotation @ shift)
        rotation = rotation @ turn
        spec.delete(joint)
    body.pos, body.quat = translation, _quaternion(rotation)
    body.alt.type = type(body.alt.type).mjORIENTATION_QUAT
    if length != 1.0:
        body.ipos = length * model.body_ipos[body.id]


def _set_masses(links: list[Any], arm: Description, length: float, tree: Array) -> None:
    """Give the mass of each row of the tree to the first of its links, and none to the others."""
    done: set[int] = set()
    for body, row, placement in zip(links, arm.links.rows, arm.links.placements, strict=True):
        if row < 0:
            continue
        if row in done:
            set_inertial(body, 0.0, np.zeros(3), np.zeros((3, 3)))
            continue
        done.add(row)
        numbers, axes, origin = rows(tree)[row], placement[:, :3], length * placement[:, 3]
        mass = numbers[Column.MASS]
        center = numbers[Column.MOMENT : Column.INERTIA] / mass
        about = inertia_matrix(numbers) - mass * steiner(center)
        set_inertial(body, mass, axes.T @ (center - origin), axes.T @ about @ axes)


def _quaternion(rotation: Array) -> Array:
    """Unit quaternion w, x, y, z of a rotation matrix."""
    quaternion = np.empty(4)
    load_mujoco().mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion
