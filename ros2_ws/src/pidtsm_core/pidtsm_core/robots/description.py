"""An arm as data: from URDF or MJCF to the flat array of `tree`, by MuJoCo's compiler."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import did_you_mean
from pidtsm_core.robots.chains import Chain, find_chain, how_to_choose
from pidtsm_core.robots.compiler import CONNECT, COUPLE, HINGE, SLIDE, WELD, motor_limits, parse
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.inertials import Inertial, compile_bodies, possible
from pidtsm_core.robots.other_joints import OtherJoint, other_joint
from pidtsm_core.robots.tree.layout import GRAVITY, Column, rotation, rows, set_inertia, size
from pidtsm_core.robots.urdf import check_ranges


@dataclass(frozen=True)
class Links:
    """The links of a description, parents before their children, for pictures: see `placement`.

    Attributes:
        names: their names; the first is the base.
        parents: index of the parent, shape (links,); -1 for the base.
        rows: row of the tree that the link moves with, shape (links,); -1: it does not move.
        placements: from the frame of the link to that of this row, shape (links, 3, 4): rotation and, in the last
            column, translation (m).
    """

    names: tuple[str, ...]
    parents: NDArray[np.int_]
    rows: NDArray[np.int_]
    placements: Array


@dataclass(frozen=True)
class Description:
    """An arm as data; every array is in the order of `joints`.

    Attributes:
        joints: names of the movable joints.
        tree: see `tree.layout`, shape (size(joints),).
        slides: whether a joint is prismatic, shape (joints,).
        lower, upper: position limits, shape (joints,), rad or m; infinite if there are none (a continuous joint).
        velocity: velocity limits, shape (joints,), rad/s or m/s; infinite if there are none.
        effort: effort limits, shape (joints,), N m or N; infinite if there are none.
        damping: viscous friction, shape (joints,), N m s/rad or N s/m.
        friction: Coulomb friction, shape (joints,), N m or N.
        locked: positions of the joints that do not move, by name, rad or m.
        grippers: those of them that were recognised as a gripper, and why; empty: the user has chosen the joints.
        tool_row: row of the tree of the link that carries the tool.
        tool: origin of the tool frame in that link, shape (3,), m. The tool is the end of the chain of fixed links
            behind the last joint, if that chain does not branch; otherwise the link behind the last joint.
        tool_rotation: from the tool frame to the frame of that link, shape (3, 3).
        tool_link: index of the link whose frame is that of the tool, in `links`.
        links: all links, also those that the tree does not keep.
        text: the text of the description.
        is_urdf: whether that is a URDF, and not an MJCF.
        others: the joints of `locked`, by name.
    """

    joints: tuple[str, ...]
    tree: Array
    slides: NDArray[np.bool_]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    damping: Array
    friction: Array
    locked: Mapping[str, float]
    grippers: Mapping[str, str]
    tool_row: int
    tool: Array
    tool_rotation: Array
    tool_link: int
    links: Links
    text: str
    is_urdf: bool
    others: Mapping[str, OtherJoint] = field(default_factory=dict)

    @property
    def urdf(self) -> str:
        """The text of the description, if it is a URDF; empty: it is an MJCF."""
        return self.text if self.is_urdf else ""


@dataclass(frozen=True)
class _Model:
    """A compiled model, and what MuJoCo's compiler does not read from a URDF.

    Attributes:
        model: of type ``mujoco.MjModel``. Its first body is the world.
        names: names of the joints.
        base: body that is the base: 0, the world, in an MJCF; 1 in a URDF, unless its base is called world.
        limits: by joint of a URDF, the attributes of its element ``limit``.
        text: the text of the description.
        is_urdf: whether it is a URDF.
        inertials: those that the model does not have, by body, see `compile_bodies`.
    """

    model: Any
    names: tuple[str, ...]
    base: int
    limits: Mapping[str, Mapping[str, float]]
    text: str
    is_urdf: bool
    inertials: Mapping[int, Inertial]


def read_description(
    text: str, joints: Sequence[str] | None = None, locked: Mapping[str, float] | None = None
) -> Description:
    """Read an arm from the text of a URDF or MJCF.

    Args:
        text: the description; meshes need not exist.
        joints: names of the movable joints in the order of all arrays; None: the chain of `find_chain`, without joints
            in `locked`.
        locked: positions of other joints, rad or m; the joints that are neither in `joints` nor here are locked at
            zero, or at the limit next to zero.

    Raises:
        DescriptionError: the text cannot be read, or describes nothing that `tree` can represent.
    """
    compiled = _compile(text)
    _check_types(compiled)
    chain = find_chain(compiled.model, compiled.names) if joints is None else Chain(tuple(joints))
    chosen = tuple(joint for joint in chain.joints if joints is not None or joint not in (locked or {}))
    _check_joints(compiled, chosen, locked or {})
    return _Assembly(compiled, chosen, locked or {}).description(chain.grippers)


def _compile(text: str) -> _Model:
    """Compile a description without its geometry."""
    parsed = parse(text)
    model, inertials = compile_bodies(parsed.spec)
    names = tuple(model.joint(i).name for i in range(model.njnt))
    for name, inertia in parsed.rotors.items():
        if name in names:
            model.dof_armature[model.joint(name).dofadr] = inertia
    return _Model(model, names, parsed.base, parsed.limits, text, parsed.is_urdf, inertials)


def _check_types(compiled: _Model) -> None:
    """Check that the tree can represent the joints."""
    m, names = compiled.model, compiled.names
    for i, name in enumerate(names):
        if m.jnt_type[i] not in (SLIDE, HINGE):
            raise DescriptionError(
                f"joint {name or i}: it lets link {m.body(m.jnt_bodyid[i]).name} float or turn freely; floating and "
                "ball joints are not supported, so remove it or replace it"
            )


def _check_joints(compiled: _Model, chosen: Sequence[str], locked: Mapping[str, float]) -> None:
    """Check that the chosen joints exist and can move, and that the locked ones exist."""
    m, names = compiled.model, compiled.names
    for name in (*chosen, *locked):
        if name not in names:
            hint = did_you_mean(name, names)
            raise DescriptionError(f"there is no movable joint {name}; there are {', '.join(names) or 'none'}{hint}")
    if not chosen:
        raise DescriptionError(f"no joint moves; {how_to_choose(m, names)}")
    for name in chosen:
        if list(chosen).count(name) > 1:
            raise DescriptionError(f"joint {name} is chosen twice")
        if name in locked:
            raise DescriptionError(f"joint {name} is both chosen and locked")
    for name, value in locked.items():
        if not math.isfinite(value):
            raise DescriptionError(f"joint {name} cannot be locked at {value}")
    given = {name: dict(zip(("lower", "upper"), m.jnt_range[i], strict=True)) for i, name in enumerate(names)}
    # Without a range, an MJCF has zeros.
    ranges = {name: each for name, each in given.items() if any(each.values())}
    check_ranges(compiled.limits if compiled.is_urdf else ranges, chosen)
    _check_couplings(compiled, chosen)


def _check_couplings(compiled: _Model, chosen: Sequence[str]) -> None:
    """Check that no chosen joint mimics another one."""
    m, names = compiled.model, compiled.names
    for i in range(m.neq):
        joint = names[m.eq_obj1id[i]] if m.eq_type[i] == COUPLE else ""
        if joint in chosen:
            other = names[m.eq_obj2id[i]] if m.eq_obj2id[i] >= 0 else "a constant"
            raise DescriptionError(f"joint {joint} mimics {other}; choose joints without it, with --joints a,b,c")


@dataclass(frozen=True)
class _Placement:
    """A frame on a link of the tree: row of that link (-1: the base), rotation, translation (m)."""

    row: int
    rotation: Array
    translation: Array

    def at(self, rotated: Array, translated: Array) -> "_Placement":
        """A frame whose placement in this frame is known."""
        return _Placement(self.row, self.rotation @ rotated, self.translation + self.rotation @ translated)


class _Assembly:
    """Turns a compiled model into a `Description`, body by body; MuJoCo lists parents before their children."""

    def __init__(self, compiled: _Model, chosen: Sequence[str], locked: Mapping[str, float]) -> None:
        self._compiled, self._chosen, self._given = compiled, tuple(chosen), locked
        self._model = compiled.model
        self._tree = np.zeros(size(len(chosen)))
        self._rows = rows(self._tree)
        self._tree[:GRAVITY] = self._model.opt.gravity
        self._used: list[int] = []  # joint of the model in each row
        self._locked: dict[str, float] = {}
        self._others: dict[str, OtherJoint] = {}
        self._bodies = [_Placement(-1, np.eye(3), np.zeros(3))]
        self._inertias = np.zeros((len(chosen), 3, 3))
        self._impossible: dict[int, str] = {}  # by row: a link whose inertia the compiler refuses
        for body in range(1, self._model.nbody):
            self._bodies.append(self._moved(body))
            self._add_mass(body)
        self._check_masses()
        self._check_loops()
        for row, inertia in zip(self._rows, self._inertias, strict=True):
            set_inertia(row, inertia)

    def _moved(self, body: int) -> _Placement:
        """Placement of a body on the tree; adds the rows of its joints."""
        m = self._model
        here = self._bodies[int(m.body_parentid[body])].at(rotation_of(m.body_quat[body]), m.body_pos[body])
        for joint in range(m.body_jntadr[body], m.body_jntadr[body] + m.body_jntnum[body]):
            if self._compiled.names[joint] in self._chosen:
                here = self._add_row(joint, here)
            else:
                here = self._lock(joint, here)
        return here

    def _add_row(self, joint: int, here: _Placement) -> _Placement:
        m = self._model
        turned, slides = _onto(m.jnt_axis[joint]), m.jnt_type[joint] == SLIDE
        frame = here.at(turned, m.jnt_pos[joint])
        row = self._rows[len(self._used)]
        row[Column.SLIDES] = slides
        row[Column.PARENT] = here.row
        row[Column.PLACE] = self._chosen.index(self._compiled.names[joint])
        rotation(row)[:] = frame.rotation
        row[Column.TRANSLATION : Column.MASS] = frame.translation
        row[Column.ARMATURE] = m.dof_armature[m.jnt_dofadr[joint]]
        self._used.append(joint)
        return _Placement(len(self._used) - 1, turned.T, -turned.T @ m.jnt_pos[joint])

    def _lock(self, joint: int, here: _Placement) -> _Placement:
        m, name = self._model, self._compiled.names[joint]
        self._others[name] = other = other_joint(m, self._compiled.names, joint)
        value = self._given.get(name, min(max(0.0, other.lower), other.upper))
        self._locked[name] = value
        return here.at(*joint_displacement(m, joint, value))

    def _add_mass(self, body: int) -> None:
        m, frame = self._model, self._bodies[body]
        if frame.row < 0:
            return
        mass = m.body_mass[body]
        principal = frame.at(rotation_of(m.body_iquat[body]), m.body_ipos[body])
        centre, axes = principal.translation, principal.rotation
        about = axes @ np.diag(m.body_inertia[body]) @ axes.T
        if (given := self._compiled.inertials.get(body)) is not None:
            mass, centre = given.mass, frame.translation + frame.rotation @ given.center
            about = frame.rotation @ given.inertia @ frame.rotation.T
            self._impossible.setdefault(frame.row, m.body(body).name)
        self._rows[frame.row, Column.MASS] += mass
        self._rows[frame.row, Column.MOMENT : Column.INERTIA] += mass * centre
        self._inertias[frame.row] += about + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))

    def _check_masses(self) -> None:
        for i, (row, joint) in enumerate(zip(self._rows, self._used, strict=True)):
            link, name = self._model.body(self._model.jnt_bodyid[joint]).name, self._compiled.names[joint]
            if not row[Column.MASS] > 0.0:
                raise DescriptionError(f"link {link}: joint {name} moves it, and it has no mass; give it an inertial")
            if i in self._impossible:
                moment = row[Column.MOMENT : Column.INERTIA]
                self._inertias[i] = possible(self._inertias[i], row[Column.MASS], moment, f"link {self._impossible[i]}")

    def _check_loops(self) -> None:
        m = self._model
        for i in range(m.neq):
            ends = self._bodies[m.eq_obj1id[i]].row, self._bodies[m.eq_obj2id[i]].row
            if m.eq_type[i] in (CONNECT, WELD) and m.eq_active0[i] and ends[0] != ends[1]:
                raise DescriptionError(f"constraint {m.eq(i).name or i} closes a loop, which is not supported")

    def description(self, grippers: Mapping[str, str]) -> Description:
        """The result, in the order of the chosen joints."""
        m, names, body = self._model, self._compiled.names, self._tool_body()
        tool = self._bodies[body]
        order = [names.index(name) for name in self._chosen]
        dofs = m.jnt_dofadr[order]
        limits = [self._compiled.limits.get(name, {}) for name in self._chosen]
        bounded = m.jnt_limited[order].astype(bool)
        forces = np.where(m.jnt_actfrclimited[order].astype(bool), m.jnt_actfrcrange[order, 1], math.inf)
        forces = np.minimum(forces, motor_limits(m)[order])
        return Description(
            joints=self._chosen,
            tree=self._tree,
            slides=np.array(m.jnt_type[order] == SLIDE),
            lower=np.where(bounded, m.jnt_range[order, 0], -math.inf),
            upper=np.where(bounded, m.jnt_range[order, 1], math.inf),
            velocity=np.array([each.get("velocity") or math.inf for each in limits]),
            effort=np.array([each.get("effort") or force for each, force in zip(limits, forces, strict=True)]),
            damping=np.array(m.dof_damping[dofs]).reshape(-1),
            friction=np.array(m.dof_frictionloss[dofs]).reshape(-1),
            locked=self._locked,
            grippers=grippers,
            tool_row=tool.row,
            tool=tool.translation,
            tool_rotation=tool.rotation,
            tool_link=body - self._compiled.base,
            links=self._links(),
            text=self._compiled.text,
            is_urdf=self._compiled.is_urdf,
            others=self._others,
        )

    def _links(self) -> Links:
        m, base = self._model, self._compiled.base
        placements = self._bodies[base:]
        parents = m.body_parentid[base:].astype(int) - base
        parents[0] = -1
        return Links(
            names=tuple(m.body(body).name or f"body{body}" for body in range(base, m.nbody)),
            parents=parents,
            rows=np.array([each.row for each in placements]),
            placements=np.array([np.column_stack([each.rotation, each.translation]) for each in placements]),
        )

    def _tool_body(self) -> int:
        m = self._model
        body = int(m.jnt_bodyid[self._used[-1]])
        while len(children := np.flatnonzero(m.body_parentid == body)) == 1 and m.body_jntnum[children[0]] == 0:
            body = int(children[0])
        return body


def joint_displacement(model: Any, joint: int, value: float) -> tuple[Array, Array]:
    """How a joint at a position (rad or m) moves its body: rotation, shape (3, 3), and translation, shape (3,), m.

    Args:
        model: of type ``mujoco.MjModel``.
        joint: index of the joint.
        value: its position, rad or m.
    """
    if model.jnt_type[joint] == SLIDE:
        return np.eye(3), model.jnt_axis[joint] * value
    turned, c, s = _onto(model.jnt_axis[joint]), math.cos(value), math.sin(value)
    spin = turned @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ turned.T
    return spin, model.jnt_pos[joint] - spin @ model.jnt_pos[joint]


def rotation_of(quaternion: Array) -> Array:
    """Rotation matrix, shape (3, 3), of a unit quaternion w, x, y, z, shape (4,)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _onto(axis: Array) -> Array:
    """A rotation whose third column is the unit vector `axis`."""
    x = np.cross([1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
