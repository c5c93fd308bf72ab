"""The visible shape of an arm, with few triangles, for the pages: its mesh files and primitives."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import cache_folder
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import DESCRIPTION, Description, TreeRobot, find_robot
from pidtsm_core.robots.bounds import ASSET
from pidtsm_core.robots.compiler import parse
from pidtsm_studies.reports.packed import packed
from pidtsm_studies.reports.shapes import Shape, shapes_of

if TYPE_CHECKING:
    from trimesh import Trimesh

TRIANGLES = 3000
"""Approximate number of triangles of an arm: a browser without a graphics card draws them in a few milliseconds."""
_FEWEST = 60
"""Triangles of a mesh that an arm with many meshes gives each at least."""
_CELLS = (64, 40, 24, 12)
"""Corners of a mesh that are closer to each other than its size divided by this become one; the next coarser grid is
tried while the edges of many small parts do not collapse."""
_ABOUT = 1.3
"""Times as many triangles are few enough."""
_SIDES = 16
"""Of a cylinder."""


class Solid(NamedTuple):
    """What moves with a joint, or the base, as triangles."""

    row: int  # of the tree; -1: the base
    corners: Array  # in the frame of the row, shape (corners, 3), m
    triangles: Array  # indices of their corners, shape (triangles, 3)


def solids(parameters: Mapping[str, object]) -> list[Solid]:
    """What the arm of these parameters looks like, see `solids_of`; empty if it is not known."""
    try:
        robot = find_robot(parameters) if parameters else None
    except ParameterError:
        return []
    source = str(parameters.get(DESCRIPTION.name, ""))
    return solids_of(robot.description, source) if isinstance(robot, TreeRobot) else []


def solids_of(arm: Description, source: str) -> list[Solid]:
    """What an arm looks like: one `Solid` for each frame that has a shape.

    Empty if no file of a mesh is known: lines then show more than a few primitives.

    Args:
        arm: the arm.
        source: of its description, see `pidtsm_core.robots.source.read_source`.
    """
    found: dict[int, list[tuple[Array, Array]]] = defaultdict(list)
    for link, corners, triangles in _of_urdf(arm, source) if arm.is_urdf else _of_mjcf(arm):
        placement = arm.links.placements[link]
        found[int(arm.links.rows[link])].append((corners @ placement[:, :3].T + placement[:, 3], triangles))
    return [_together(row, parts) for row, parts in found.items()]


def _of_urdf(arm: Description, source: str) -> Iterator[tuple[int, Array, Array]]:
    """Index of the link, corners in its frame, and triangles of each shape."""
    is_path = not source.lstrip().startswith("<") and Path(source).suffix != ""
    shapes, _ = shapes_of(arm.urdf, Path(source) if is_path else None)
    files = sum(shape.kind == "mesh" for each in shapes.values() for shape in each)
    for link, name in enumerate(arm.links.names):
        for shape in shapes.get(name, ()) if files else ():
            if (drawn := _drawn(shape, max(_FEWEST, TRIANGLES // files))) is not None:
                yield link, *drawn


def _of_mjcf(arm: Description) -> Iterator[tuple[int, Array, Array]]:
    """As `_of_urdf`: the meshes that only show, or all if others than these do not exist."""
    kept = _memory().cache(reduced)
    model = parse(arm.text).spec.compile()
    meshes = np.flatnonzero((model.geom_dataid >= 0) & (model.geom_rgba[:, 3] > 0.0))
    only_seen = meshes[(model.geom_contype[meshes] == 0) & (model.geom_conaffinity[meshes] == 0)]
    chosen = only_seen if only_seen.size else meshes
    for geom in chosen.tolist():
        each = int(model.geom_dataid[geom])
        corner, face = model.mesh_vertadr[each], model.mesh_faceadr[each]
        vertices = model.mesh_vert[corner : corner + model.mesh_vertnum[each]]
        faces = model.mesh_face[face : face + model.mesh_facenum[each]]
        corners, triangles = kept(vertices, faces, max(_FEWEST, TRIANGLES // chosen.size))
        turn = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
        yield int(model.geom_bodyid[geom]), turn.apply(corners) + model.geom_pos[geom], triangles


def packed_solid(solid: Solid) -> dict[str, Any]:
    """Plain data for meshes.js: ``row``; and packed, ``corners`` and ``triangles``."""
    return {"row": solid.row, "corners": packed(solid.corners), "triangles": packed(solid.triangles)}


def _drawn(shape: Shape, most: int) -> tuple[Array, Array] | None:
    """Corners in the frame of the link, and triangles; None if its file cannot be read."""
    import trimesh

    if shape.file is not None:
        found = _stored(shape.file, most)
        if found is None:
            return None
        corners, triangles = found[0] * shape.size, found[1]
    else:
        creation = trimesh.creation
        made = {
            "box": lambda: creation.box(shape.size),
            "cylinder": lambda: creation.cylinder(*shape.size, sections=_SIDES),
            "sphere": lambda: creation.icosphere(1, *shape.size),
        }[shape.kind]()
        corners, triangles = made.vertices, made.faces
    return Rotation.from_quat(shape.turn).apply(corners) + shape.translation, np.asarray(triangles)


def _together(row: int, parts: Sequence[tuple[Array, Array]]) -> Solid:
    """Meshes of a frame as one."""
    begins = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    triangles = [each + begin for (_, each), begin in zip(parts, begins, strict=False)]
    return Solid(row, np.concatenate([corners for corners, _ in parts]), np.concatenate(triangles))


def _memory() -> Any:
    """The cache of meshes, of type ``joblib.Memory``."""
    from joblib import Memory

    return Memory(cache_folder() / "meshes", verbose=0)


def _stored(file: Path, most: int) -> tuple[Array, Array] | None:
    """`simplified`, from the cache if the file has not changed; None if it cannot be read, or is not drawable."""
    status = file.stat()
    if status.st_size > ASSET:
        return None
    kept = _memory().cache(simplified)
    # What libraries raise at a file that is damaged is not specified; an arm without one of its meshes is no failure.
    with suppress(Exception):
        corners, triangles = kept(str(file), status.st_mtime_ns, status.st_size, most)
        if len(triangles) and np.isfinite(corners).all():
            return corners, triangles
    return None


def simplified(file: str, changed: int, size: int, most: int) -> tuple[Array, Array]:  # noqa: ARG001  Key of a cache.
    """The mesh of a file with about so many triangles, see `fewer`.

    Args:
        file: in a format of trimesh.
        changed: when the file has changed, by which a cache knows it, ns.
        size: of the file, likewise, bytes.
        most: number of triangles.

    Returns:
        Corners, m, shape (corners, 3), and indices of the corners of each triangle, shape (triangles, 3).
    """
    import trimesh

    mesh = fewer(trimesh.load_scene(file).to_mesh(), most)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def reduced(corners: Array, triangles: Array, most: int) -> tuple[Array, Array]:
    """A mesh with about so many triangles, see `fewer`; arguments and result like the result of `simplified`."""
    import trimesh

    mesh = fewer(trimesh.Trimesh(corners, triangles), most)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def fewer(whole: "Trimesh", most: int) -> "Trimesh":
    """A mesh with about so many triangles: by edge collapse, after small parts are merged.

    Args:
        whole: the mesh.
        most: number of triangles.
    """
    for cells in _CELLS:
        mesh, cell = whole.copy(), float(whole.extents.max()) / cells
        mesh.apply_scale(1.0 / cell)
        mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=0)
        mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
        if len(mesh.faces) > most:
            mesh = mesh.simplify_quadric_decimation(face_count=most)
        if len(mesh.faces) <= _ABOUT * most:
            break
    mesh.remove_unreferenced_vertices()
    return mesh.apply_scale(cell)
