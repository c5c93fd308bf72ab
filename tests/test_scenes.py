"""What acts on the arm from outside, over the nodes: contacts in a scene, and pushes on the tool."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.node_parameters import simulator_node_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.runs.runner import run

WALL = """<mujoco><worldbody>
<geom name="wall" type="box" size="0.05 1 1" pos="0.47 0 0.5"/>
<body name="box" pos="-1 0 0.5"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""
NAMES = ["joint1", "joint2"]
EFFORT = [40.0, 5.0]
PUSH = [3.0, 1.0, -8.0, 0.0, -2.0, 0.5]


def test_contacts_are_recorded_and_the_run_is_that_of_the_rollout(tmp_path: Path) -> None:
    (tmp_path / "wall.xml").write_text(WALL, encoding="utf-8")
    overrides = ["simulator.engine=mujoco", f"simulator.scene={tmp_path / 'wall.xml'}"]
    experiment = make_experiment(None, duration=1.5, overrides=overrides, robot="panda")
    bag = run(experiment, "lockstep", tmp_path, lambda _time: None)
    recording, simulated = read_recording(bag), rollout(experiment)
    assert recording.position.tobytes() == simulated.position.tobytes()
    assert recording.effort.tobytes() == simulated.effort.tobytes()
    with AnyReader([bag], default_typestore=typestore()) as reader:
        found = {c.topic.rpartition("/")[2] for c in reader.connections if c.msgtype.endswith("WrenchStamped")}
        assert {"push", "panda_link7"} <= found
        touched = [c for c in reader.connections if c.topic == "/simulator/contact/panda_link7"]
        wrenches: list[Any] = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(touched)]
    stamps = [w.header.stamp.sec + 1e-9 * w.header.stamp.nanosec for w in wrenches]
    assert {w.header.frame_id for w in wrenches} == {"panda_link7"}
    assert len(stamps) > 100
    assert sorted(set(stamps)) == stamps
    free = rollout(make_experiment(None, duration=1.5, overrides=overrides[:1], robot="panda"))
    apart = np.abs(free.position - simulated.position).max(axis=1)
    assert apart[simulated.time < stamps[0]].max() == 0.0
    assert apart[-1] > 1e-3


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_a_push_acts_on_the_tool_for_a_tenth_of_a_second(testbed: Testbed, engine: str) -> None:
    states: list[JointState] = testbed.hear(JointState, "joint_states", 200)
    commands = testbed.node.create_publisher(JointState, "joint_commands", 200)
    pushes = testbed.node.create_publisher(WrenchStamped, "simulator/push", 10)
    simulator = testbed.start("simulator", "start.subscribers:=1", "clock:=lockstep", f"engine:={engine}")
    testbed.spin_until(lambda: states and commands.get_subscription_count() and pushes.get_subscription_count(), "it")
    pushes.publish(WrenchStamped(header=Header(frame_id="tool")))
    testbed.spin_until(lambda: "must be in those of base_link" in simulator.log.read_text(), "a refusal")
    heard: list[list[float]] = []
    for k in range(200):
        testbed.spin_until(lambda: len(states) > k, f"joint state {k}")  # noqa: B023
        heard.append(list(states[k].position))
        if k == 20:
            wrench = Wrench(force=Vector3(x=PUSH[0], y=PUSH[1], z=PUSH[2]))
            wrench.torque = Vector3(x=PUSH[3], y=PUSH[4], z=PUSH[5])
            pushes.publish(WrenchStamped(wrench=wrench))
        command = JointState(name=NAMES, effort=EFFORT)
        command.header.stamp = states[k].header.stamp
        commands.publish(command)
    assert any(heard == pushed(engine, begin) for begin in range(20, 60))
    assert heard != pushed(engine, 1000)


def pushed(engine: str, begin: int) -> list[list[float]]:
    """Positions of an arm that is pushed for 100 samples from this one on."""
    robot = SimulatedRobot(resolve(simulator_node_schema, {"engine": engine}, 2))
    positions = []
    for k in range(200):
        _, measured = robot.sense(k)
        positions.append(measured.tolist())
        if k in (begin, begin + 100):
            robot.push(np.array(PUSH) if k == begin else np.zeros(6))
        robot.act(k, True, np.array(EFFORT))
    return positions
