"""The tool on the live page: dragged by its gizmo, its stiffness set by a slider, and the wrench on it shown."""

import os
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from scipy.spatial.transform import Rotation
from support.liveclient import LiveClient, live_client
from support.livepage import LiveSystem, live_process, parameter, until

from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import link_placements
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.middleware import on_this_machine

PANDA = find_description({"robot.description": "panda"})
DOWN = np.array([0.0, 0.0, -0.04])
"""By which the tool is dragged, m."""


class Stranger(NamedTuple):
    """A node of the test's on the graph of the page, and what it has heard."""

    executor: Any
    poses: list[PoseStamped]
    states: list[ControllerState]

    def tool(self) -> Any:
        """Where the controller has the tool, shape (3, 4)."""
        place = dict(zip(self.states[-1].name, self.states[-1].position, strict=True))
        return link_placements(PANDA, np.array([place[joint] for joint in PANDA.joints]))[PANDA.tool_link]

    def until(self, condition: Any, what: str) -> None:
        def met() -> Any:
            for _ in range(20):
                self.executor.spin_once(timeout_sec=0.005)
            return condition()

        until(met, what)


class Live(NamedTuple):
    system: LiveSystem
    client: LiveClient
    stranger: Stranger


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    options = ("--robot", "panda", "--set", "trajectory.reference.amplitude=0.0")
    with (
        live_process(tmp_path_factory.mktemp("tool"), *options) as system,
        live_client(system.address) as client,
        pytest.MonkeyPatch.context() as patch,
    ):
        for variable, value in on_this_machine(os.environ).items():
            patch.setenv(variable, value)
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=system.domain)
        node = Node("stranger", context=context)
        executor = EventsExecutor(context=context)
        executor.add_node(node)
        found = Stranger(executor, [], [])
        node.create_subscription(PoseStamped, "/live/trajectory/pose_target", found.poses.append, 10)
        state = "/live/controller/state"
        node.create_subscription(ControllerState, state, found.states.append, qos_profile_sensor_data)
        until(lambda: "Following" in client.shown('id="status"'), "the arm follows")
        yield Live(system, client, found)
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def test_the_tool_follows_its_gizmo(live: Live) -> None:
    client, stranger = live.client, live.stranger
    stranger.until(lambda: stranger.states, "states of the controller")
    place = stranger.tool()
    turn = Rotation.from_matrix(place[:, :3]).as_quat(scalar_first=True).tolist()

    def drag(by: Any) -> None:
        where = (place[:, 3] + by).tolist()
        kind = "TransformControlsUpdateMessage"
        client.send({"type": kind, "name": "/tool", "wxyz": turn, "position": where, "owner": ""})

    client.find("drag the tool")
    drag(DOWN)  # Without the box, nothing may come of it; what follows is sent after it.
    client.enter("drag the tool", value=True)
    until(lambda: client.scene.get("/tool", {}).get("visible"), "the gizmo is there")
    assert not stranger.poses
    client.send({"type": "TransformControlsDragStartMessage", "name": "/tool", "owner": ""})
    for share in np.linspace(0.0, 1.0, 5):
        drag(share * DOWN)
    aim = place[:, 3] + DOWN
    stranger.until(lambda: np.linalg.norm(stranger.tool()[:, 3] - aim) < 2e-3, "the tool is where it was dragged")
    last = stranger.poses[-1]
    assert last.header.frame_id == ""
    np.testing.assert_allclose([last.pose.position.x, last.pose.position.y, last.pose.position.z], aim, atol=1e-9)
    count = len(stranger.poses)
    stranger.until(lambda: len(stranger.poses) > count + 10, "it is held there while the mouse is")
    client.send({"type": "TransformControlsDragEndMessage", "name": "/tool", "owner": ""})
    client.enter("drag the tool", value=False)
    until(lambda: not client.scene["/tool"]["visible"], "the gizmo is gone")


def test_the_slider_sets_the_stiffness_and_undo_sets_it_back(live: Live) -> None:
    before = parameter(live.system, "compliance.stiffness")
    live.client.enter("stiffness [N/m]", 500.0)
    until(lambda: parameter(live.system, "compliance.stiffness")[:3] == (500.0, 500.0, 500.0), "the stiffness is set")
    assert parameter(live.system, "compliance.stiffness")[3:] == before[3:]
    live.client.press("Undo")
    until(lambda: parameter(live.system, "compliance.stiffness") == before, "the stiffness of before")
    until(lambda: live.client.find("stiffness [N/m]")["value"] == before[0], "the slider shows it")


def test_a_push_is_an_arrow_with_its_force(live: Live) -> None:
    client = live.client

    def force() -> float:
        found = re.search(r"wrench on the tool: ([\d.]+) N", client.shown("wrench on the tool"))
        return float(found[1]) if found else 0.0

    client.enter("for [s]", 5.0)
    client.press("Push")
    until(lambda: abs(force() - 50.0) < 5.0, lambda: f"a force of 50 N, not {force()}")
    until(lambda: client.scene.get("/wrench", {}).get("visible"), "the arrow is there")
    until(lambda: "points" in client.scene["/wrench"], "it has a direction")
