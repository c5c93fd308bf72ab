"""The visualization node turns the messages of the loop into what viewers show, for any arm."""

from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from support.testbed import Testbed
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from pidtsm_core.robots import Description, find_description
from pidtsm_core.robots.placement import link_placements
from pidtsm_msgs.msg import JointReference

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MJCF = """<mujoco><worldbody><body name="cart">
    <joint name="rail" type="slide" axis="1 0 0" actuatorfrcrange="-8 8"/><geom size="0.1"/>
    <body name="bob" pos="0 0 -1"><joint name="pin" axis="0 1 0" pos="0 0 1"/><geom size="0.1"/></body>
</body></worldbody></mujoco>"""


class Loop:
    """Publishes what simulator, trajectory and controller do, joints in another order."""

    def __init__(self, testbed: Testbed, joints: tuple[str, ...]) -> None:
        create = testbed.node.create_publisher
        self.states = create(JointState, "joint_states", 10)
        self.commands = create(JointState, "joint_commands", 10)
        self.references = create(JointReference, "reference", 10)
        self.names = joints[::-1]
        self.positions = [0.5 - 0.3 * i for i in range(len(joints))]
        self.efforts = [4.0] * len(joints)
        self.desired = [*[0.4] * (len(joints) - 1), float("nan")]

    def publish(self) -> None:
        header = Header(stamp=Time(sec=7))
        self.states.publish(JointState(header=header, name=self.names, position=self.positions))
        self.commands.publish(JointState(header=header, name=self.names, effort=self.efforts))
        self.references.publish(JointReference(header=header, name=self.names, position=self.desired))


def frames(loop: Loop, heard: list[TFMessage]) -> dict[str, Any]:
    """Let the loop publish something, and return the transforms received so far, by link."""
    loop.publish()
    return {frame.child_frame_id: frame for message in heard for frame in message.transforms}


def origins(arm: Description, q: list[float]) -> dict[str, list[float]]:
    """Origin of every link in the frame of its parent."""
    placements = link_placements(arm, np.array(q))
    found = {}
    for name, parent, placement in zip(arm.links.names[1:], arm.links.parents[1:], placements[1:], strict=True):
        above = placements[parent]
        found[name] = (above[:, :3].T @ (placement - above)[:, 3]).tolist()
    return found


@pytest.mark.parametrize("name", ["two_link", "panda", "scara"])
def test_arm_and_reference_are_shown(testbed: Testbed, name: str) -> None:
    testbed.start("visualization", f"robot.description:={name}")
    arm = find_description({"robot.description": name})
    descriptions = testbed.hear(String, "robot_description", LATCHED)
    markers = testbed.hear(MarkerArray, "visualization/markers")
    heard = testbed.hear(TFMessage, "tf")
    loop = Loop(testbed, arm.joints)

    def whole() -> bool:
        loop.publish()
        return bool(
            descriptions
            and any(len(message.markers) == 2 + len(arm.joints) for message in markers)
            and any(len(message.transforms) == 2 * len(arm.links.names) - 1 for message in heard)
        )

    testbed.spin_until(whole, "the arm, its reference and the efforts")
    assert f'<robot name="{name}"' in descriptions[0].data
    shown = next(message.markers for message in markers if len(message.markers) == 2 + len(arm.joints))
    assert [m.ns for m in shown] == ["arm", "reference", *["effort"] * len(arm.joints)]
    assert {m.header.frame_id for m in shown} == {arm.links.names[0]}
    assert {m.header.stamp.sec for m in shown} == {7}
    assert [m.color.r for m in shown[2:]] == pytest.approx((4.0 / arm.effort).tolist(), rel=1e-6)
    transforms = next(m.transforms for m in heard if len(m.transforms) == 2 * len(arm.links.names) - 1)
    steps = {frame.child_frame_id: frame.transform.translation for frame in transforms}
    desired = [0.0, *[0.4] * (len(arm.joints) - 1)]  # A value that is not finite is left out.
    expected = origins(arm, loop.positions[::-1])
    expected |= {f"reference/{link}": origin for link, origin in origins(arm, desired).items()}
    for link, origin in expected.items():
        assert [steps[link].x, steps[link].y, steps[link].z] == pytest.approx(origin, abs=1e-9), link


def test_an_mjcf_is_shown_as_markers_and_frames(testbed: Testbed) -> None:
    file = testbed.folder / "pendulum.xml"
    file.write_text(MJCF)
    process = testbed.start("visualization", f"robot.description:={file}", "joints:=[pin]", "robot.locked:='rail=0.3'")
    markers = testbed.hear(MarkerArray, "visualization/markers")
    heard = testbed.hear(TFMessage, "tf")
    loop = Loop(testbed, ("pin",))

    testbed.spin_until(lambda: "cart" in frames(loop, heard) and markers, "frames and markers")
    assert frames(loop, heard)["cart"].transform.translation.x == pytest.approx(0.3)
    assert process.log.read_text().count("viewers cannot read an MJCF") == 1


def test_renamed_joints_of_the_closed_form_are_shown(testbed: Testbed) -> None:
    testbed.start("visualization", "joints:=[shoulder, elbow]")
    heard = testbed.hear(TFMessage, "tf")
    loop = Loop(testbed, ("shoulder", "elbow"))

    testbed.spin_until(lambda: "link2" in frames(loop, heard), "frames of the arm")
    assert frames(loop, heard)["link2"].transform.rotation.y == pytest.approx(-np.sin(0.25))


@pytest.mark.parametrize(
    ("parameter", "cause"),
    [
        ("robot.description:='<robot/>'", "cannot start: robot.description: the description has no links"),
        ("robot.descripton:=panda", "cannot start: unknown parameter robot.descripton; did you mean robot.description"),
    ],
)
def test_what_cannot_be_shown_is_refused(testbed: Testbed, parameter: str, cause: str) -> None:
    process = testbed.start("visualization", parameter)
    assert process.wait() == 2
    assert cause in process.tail()
    assert "Traceback" not in process.tail()
