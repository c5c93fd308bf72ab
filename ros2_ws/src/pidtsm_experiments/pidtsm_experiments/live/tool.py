"""The tool of the arm on the page: dragged by its gizmo, and the wrench on it as an arrow."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from viser import GuiEvent, TransformControlsEvent

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Description
from pidtsm_core.robots.picture import reach
from pidtsm_core.robots.placement import link_placements
from pidtsm_experiments.live.desk import Desk
from pidtsm_ros.pose_client import pose_message
from pidtsm_ros.qos import READER
from pidtsm_ros.serialization import ExactPublisher

_GIZMO = 0.3
"""Length of the arrows of the gizmo, as a share of the reach of the arm."""
_LASTS = 0.5
"""For how long the last place of the gizmo is sent, s; then it goes back to the tool."""
_RECENT = 0.5
"""Time after which a wrench is no longer shown, s."""
_NEWTON, _LONGEST = 0.01, 0.8
"""Length of the arrow for one newton, and at most, as shares of the reach."""
_LEAST = 1.0
"""Force that is shown as an arrow, N."""
_COLOR = (190, 40, 160)
_MOVED = 1e-4
"""By which the gizmo is moved at least, m or rad."""


class Tool:
    """A check box, the gizmo, and the arrow; positions are those of the arm's tool in its base."""

    def __init__(self, desk: Desk, arm: Description) -> None:
        """Add everything to the scene, and the check box to the current container."""
        self._desk, self._arm, self._size = desk, arm, reach(arm)
        node, scene = desk.system.node, desk.server.scene
        self._poses = node.create_publisher(PoseStamped, "trajectory/pose_target", 10, publisher_class=ExactPublisher)
        node.create_subscription(WrenchStamped, "controller/external_wrench", self._receive, READER)
        self._wrench, self._received = np.zeros(6), -np.inf
        self._wanted: tuple[Array, Array] | None = None
        self._dragged, self._holder = -np.inf, -1  # when, s, and by which browser
        self._gizmo = scene.add_transform_controls("/tool", _GIZMO * self._size, visible=False, depth_test=False)
        size, none = self._size, np.zeros((1, 2, 3), dtype=np.float32)
        self._arrow = scene.add_arrows(
            "/wrench",
            none,
            _COLOR,
            shaft_radius=0.01 * size,
            head_radius=0.025 * size,
            head_length=0.06 * size,
            visible=False,
        )
        self._box = desk.server.gui.add_checkbox("drag the tool", False, hint="a gizmo at the tool, which follows it")
        self._text = desk.server.gui.add_html("")
        self._shown = ""

        @self._box.on_update
        def _(event: GuiEvent[Any]) -> None:
            if event.client is None:
                return
            if self._box.value:
                self._check(on=False)  # Until it is confirmed, if the arm is real.
                desk.act(event.client, "drag the tool", self._begin, moves=True)
            else:
                self._gizmo.visible, self._holder = False, -1

        @self._gizmo.on_update
        def _(event: TransformControlsEvent) -> None:
            if self._gizmo.visible:
                self._wanted = np.array(self._gizmo.position), np.array(self._gizmo.wxyz)
                self._dragged = time.monotonic()
                self._holder = -1 if event.phase == "end" or event.client_id is None else event.client_id

    async def _begin(self) -> None:
        self._desk.system.require("trajectory")
        self._check(on=True)
        self._gizmo.visible = True
        self._desk.system.note("the gizmo drags the tool")

    def _check(self, on: bool) -> None:
        setattr(self._box, "value", on)  # noqa: B010  viser's types do not know that it can be set.

    def _receive(self, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        if np.isfinite(wrench).all():
            self._wrench, self._received = wrench, time.monotonic()

    def show(self, position: Array, reference: Array | None) -> None:
        """Send the pose that is wanted, and show the tool.

        Args:
            position: of the joints, shape (joints,), rad or m.
            reference: likewise; None: there is none.
        """
        place = link_placements(self._arm, position)[self._arm.tool_link]
        self._show_wrench(place)
        held = self._gizmo.visible and self._holder in self._desk.server.get_clients()
        if self._wanted is not None and (held or time.monotonic() - self._dragged < _LASTS):
            where, turn = self._wanted
            self._poses.publish(pose_message(where, np.roll(turn, -1), time.time_ns()))
        elif reference is not None:
            self._follow(link_placements(self._arm, reference)[self._arm.tool_link])

    def _follow(self, place: Array) -> None:
        turn = Rotation.from_matrix(place[:, :3])
        now = Rotation.from_quat(self._gizmo.wxyz, scalar_first=True)
        away = np.linalg.norm(place[:, 3] - self._gizmo.position) + (turn.inv() * now).magnitude()
        if away > _MOVED:
            self._gizmo.position, self._gizmo.wxyz = place[:, 3], turn.as_quat(scalar_first=True)

    def _show_wrench(self, place: Array) -> None:
        known = time.monotonic() - self._received < _RECENT
        force, torque = (float(np.linalg.norm(part)) for part in (self._wrench[:3], self._wrench[3:]))
        text = f"<span id='wrench'>wrench on the tool: {force:.1f} N, {torque:.2f} N m</span>" if known else ""
        if text != self._shown:
            self._shown = self._text.content = text
        if self._arrow.visible != (shown := known and force > _LEAST):
            self._arrow.visible = shown
        if shown:
            self._arrow.points = force_arrow(place, self._wrench[:3], self._size)


def force_arrow(place: Array, force: Sequence[float] | Array, size: float) -> NDArray[Any]:
    """An arrow from the origin of the tool in the direction of a force, shape (1, 2, 3), m.

    Args:
        place: of the tool in the base, shape (3, 4).
        force: in the axes of the tool, shape (3,), N.
        size: reach of the arm, m.
    """
    along = place[:, :3] @ np.asarray(force)
    along *= size * min(_NEWTON, _LONGEST / max(float(np.linalg.norm(along)), 1e-9))
    return np.stack([place[:, 3], place[:, 3] + along])[np.newaxis].astype(np.float32)
