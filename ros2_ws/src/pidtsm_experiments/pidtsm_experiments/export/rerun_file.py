"""A run as a file of the viewer rerun: the moving arm and its reference, curves, and what happened."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError, how_to_install
from pidtsm_core.recording import Recording
from pidtsm_core.robots.picture import BONE_WIDTH, bones, reach
from pidtsm_core.robots.placement import link_placements
from pidtsm_experiments.export.arm import GHOST, DrawnArm
from pidtsm_studies.reports.events import events
from pidtsm_studies.reports.shapes import Shape, shapes_of
from pidtsm_studies.reports.styles import SERIES

RATE = 50.0
"""Pictures of the arm a second."""
TIMELINE = "time"
"""Name of the time line, since the first stamp of the motion."""
_LEVELS = {"fault": "ERROR", "limit": "WARN", "contact": "WARN", "push": "WARN"}
_ARM, _EVENTS, _SCENE = "arm", "events", "scene"

_ARM_COLOR, _GHOST_COLOR = (92, 184, 255, 255), (200, 200, 200, 110)
"""Red, green, blue and opacity, on the dark background of the viewer."""

Times = NDArray[np.timedelta64]


@dataclass(frozen=True)
class Shown:
    """What the file contains.

    Attributes:
        content: the file.
        moments: pictures of each arm.
        marks: number of events.
        lacking: meshes whose files do not exist here.
    """

    content: bytes
    moments: int
    marks: int
    lacking: int


def require_rerun() -> ModuleType:
    """The module ``rerun``.

    Raises:
        UsageError: it is not installed; the message has the command that installs it.
    """
    try:
        import rerun
        import rerun.blueprint
    except ModuleNotFoundError:
        raise UsageError(f"--rerun needs rerun-sdk, for Python 3.11 or newer: {how_to_install('rerun')}") from None
    return rerun


def rerun_file(recording: Recording, arm: DrawnArm, simulator: Mapping[str, object], name: str) -> Shown:
    """Make the file.

    Args:
        recording: the run.
        arm: the arm; all of its joints are in the recording.
        simulator: parameters of the simulated arm, see `events`.
        name: of the run.

    Raises:
        UsageError: rerun-sdk is not installed, or a joint of the arm is not in the recording.
    """
    if lacking := [joint for joint in arm.joints if joint not in recording.joints]:
        raise UsageError(
            f"the recording has {', '.join(recording.joints)}, and not {', '.join(lacking)} of the arm; name the "
            "recorded arm with --robot, and its joints that move with --joints"
        )
    rerun = require_rerun()
    stream = rerun.RecordingStream("pidtsm", recording_id=name)
    memory = stream.memory_recording()
    stream.send_recording_name(name)
    stream.send_blueprint(_blueprint(rerun, reach(arm.description)))
    since = recording.stamps_ns - recording.stamps_ns[0] + round(float(recording.time[0]) * 1e9)
    time = since.astype("timedelta64[ns]")
    _add_curves(rerun, stream, recording, time)
    rows = np.unique(np.searchsorted(recording.time, np.arange(recording.time[0], recording.time[-1], 1.0 / RATE)))
    order = [recording.joints.index(joint) for joint in arm.joints]
    shapes, absent = shapes_of(arm.description.urdf)
    scene = _Scene(rerun, stream, arm, shapes)
    scene.add(_ARM, recording.position[rows][:, order], time[rows], ghost=False)
    scene.add(GHOST, recording.desired[rows][:, order], time[rows], ghost=True)
    marks = _add_events(rerun, stream, recording, simulator)
    return Shown(memory.drain_as_bytes(), rows.size, marks, absent)


def _add_curves(rerun: ModuleType, stream: Any, recording: Recording, time: Times) -> None:
    """Position, reference, error and effort of each joint, to the last bit."""
    arrays = recording.arrays()
    for j, (joint, units) in enumerate(zip(recording.joints, recording.units, strict=True)):
        color = _rgb(SERIES[j % len(SERIES)].dark)
        for quantity, unit, width in (
            ("position", units.position, 2.0),
            ("reference", units.position, 1.0),
            ("error", units.position, 1.5),
            ("effort", units.effort, 1.5),
        ):
            path = f"{quantity}/{rerun.escape_entity_path_part(joint)}"
            about = f"{joint} [{unit}]"
            stream.log(path, rerun.SeriesLines(names=about, colors=[color], widths=[width]), static=True)
            values = rerun.Scalars.columns(scalars=np.ascontiguousarray(arrays[quantity][:, j]))
            stream.send_columns(path, [rerun.TimeColumn(TIMELINE, duration=time)], values)


def _rgb(color: str) -> tuple[int, ...]:
    """Red, green and blue of a colour such as ``#0072b2``."""
    return tuple(bytes.fromhex(color.removeprefix("#")))


def _add_events(rerun: ModuleType, stream: Any, recording: Recording, simulator: Mapping[str, object]) -> int:
    """What happened, as lines of a log; returns their number."""
    happened = events(recording, recording.metrics(), simulator)
    if happened:
        time = np.array([round(event.time * 1e9) for event in happened], dtype="timedelta64[ns]")
        texts, levels = zip(*((event.text, _LEVELS.get(event.kind, "INFO")) for event in happened), strict=True)
        lines = rerun.TextLog.columns(text=texts, level=levels)
        stream.send_columns(_EVENTS, [rerun.TimeColumn(TIMELINE, duration=time)], lines)
    return len(happened)


class _Scene:
    """Where the arms are drawn."""

    def __init__(self, rerun: ModuleType, stream: Any, arm: DrawnArm, shapes: Mapping[str, list[Shape]]) -> None:
        self._rerun, self._stream, self._arm, self._shapes = rerun, stream, arm.description, shapes
        self._width = 0.5 * BONE_WIDTH * reach(self._arm)
        stream.log(_SCENE, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def add(self, name: str, positions: Array, time: Times, ghost: bool) -> None:
        """Draw an arm.

        Args:
            name: of its entity.
            positions: in the order of its joints, shape (moments, joints), rad or m.
            time: shape (moments,).
            ghost: whether it is drawn through.
        """
        rerun, stream, links = self._rerun, self._stream, self._arm.links
        placements = np.array([link_placements(self._arm, q) for q in np.ascontiguousarray(positions)])
        color = _GHOST_COLOR if ghost else _ARM_COLOR
        index = rerun.TimeColumn(TIMELINE, duration=time)
        for i, link in enumerate(links.names):
            path = f"{_SCENE}/{name}/{rerun.escape_entity_path_part(link)}"
            turns = Rotation.from_matrix(placements[:, i, :, :3]).as_quat()
            moved = rerun.Transform3D.columns(translation=placements[:, i, :, 3], quaternion=turns)
            stream.send_columns(path, [index], moved)
            for k, shape in enumerate(self._shapes.get(link, ())):
                self._add_shape(f"{path}/visual{k}", shape, color, ghost)
        if not any(self._shapes.values()):
            strips = [bones(links, placement).reshape(-1, 2, 3) for placement in placements]
            self._add_bones(f"{_SCENE}/{name}/bones", strips, index, color)

    def _add_shape(self, path: str, shape: Shape, color: tuple[int, ...], ghost: bool) -> None:
        """Draw a part of a link."""
        rerun, size = self._rerun, shape.size
        fill = rerun.components.FillMode.MajorWireframe if ghost else rerun.components.FillMode.Solid
        scale = size if shape.kind == "mesh" else None
        place = rerun.Transform3D(translation=shape.translation, quaternion=shape.turn, scale=scale)
        if shape.kind == "mesh":
            drawn = rerun.Asset3D(path=shape.file, albedo_factor=color if ghost else None)
        elif shape.kind == "box":
            drawn = rerun.Boxes3D(sizes=[size], colors=[color], fill_mode=fill)
        elif shape.kind == "cylinder":
            drawn = rerun.Cylinders3D(radii=[size[0]], lengths=[size[1]], colors=[color], fill_mode=fill)
        else:
            drawn = rerun.Ellipsoids3D(radii=[size[0]], colors=[color], fill_mode=fill)
        self._stream.log(path, place, drawn, static=True)

    def _add_bones(self, path: str, strips: Sequence[Array], index: Any, color: tuple[int, ...]) -> None:
        """Lines from link to link."""
        rerun = self._rerun
        self._stream.log(path, rerun.LineStrips3D.from_fields(radii=[self._width], colors=[color]), static=True)
        lines = rerun.LineStrips3D.columns(strips=[strip for each in strips for strip in each])
        self._stream.send_columns(path, [index], lines.partition([len(each) for each in strips]))


def _blueprint(rerun: ModuleType, size: float) -> Any:
    """What the viewer shows at first: the arm beside error, effort and position, and below them what happened.

    Args:
        rerun: the module.
        size: reach of the arm, m.
    """
    layout = rerun.blueprint
    hidden = layout.PlotLegend(visible=False)  # The joints have the same colours in all plots.
    together = ["/position/**", "/reference/**"]
    curves = layout.Vertical(
        layout.TimeSeriesView(origin="error", name="Error"),
        layout.TimeSeriesView(origin="effort", name="Effort", plot_legend=hidden),
        layout.TimeSeriesView(contents=together, name="Position (thick) and reference (thin)", plot_legend=hidden),
        layout.TextLogView(origin=_EVENTS, name="What happened"),
        row_shares=[3, 3, 3, 2],
    )
    eye = layout.EyeControls3D(position=[0.7 * size, -1.2 * size, 0.7 * size], look_target=[0.0, 0.0, 0.3 * size])
    arm = layout.Spatial3DView(origin=_SCENE, name="Arm, and its reference as a ghost", eye_controls=eye)
    return layout.Blueprint(
        layout.Horizontal(arm, curves, column_shares=[2, 3]),
        layout.TimePanel(timeline=TIMELINE, state="collapsed"),
        collapse_panels=True,
    )
