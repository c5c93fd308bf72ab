"""The Python client and ``./pidtsm move`` on a running system; in lockstep, so that a busy machine stops no arm."""

import json
import math
import runpy
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.testarms import TWO_LINK
from support.testbed import DEADLINE, Testbed, open_testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.signals import Mode
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.runner import node_parameters
from pidtsm_ros.client import Arm, ArmError, ArmNotFoundError, GoalError, TargetError

HOME = [0.3, -0.2]
EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "move_an_arm.py"
CENTRE = (0.6015, 0.0, 0.3092)
"""Where the example begins and ends, m."""


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Testbed]:
    """Simulator, controller and trajectory node; the arm rests at `HOME`."""
    with open_testbed(tmp_path_factory.mktemp("client")) as testbed, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", testbed.environment["ROS_DOMAIN_ID"])
        testbed.start("controller", "reference.match:=stamp")
        rest = [f"reference.{end}:={HOME}" for end in ("from", "to")]
        settings = ("clock:=lockstep", "reference.name:=minimum_jerk", f"robot.description:={TWO_LINK.description}")
        testbed.start("trajectory", *settings, *rest)
        settings = ("clock:=lockstep", "lockstep.timeout:=60.0", "disturbance.name:=none")
        testbed.start("simulator", f"initial_position:={HOME}", *settings)
        yield testbed


@pytest.fixture(scope="module")
def arm(system: Testbed) -> Iterator[Arm]:
    with Arm(timeout=60.0) as arm:
        yield arm


def test_its_state_is_that_of_the_controller(arm: Arm) -> None:
    state = arm.state
    assert state.names == arm.names == ("joint1", "joint2")
    assert state.mode == Mode.FOLLOWING
    assert not state.fault
    assert arm.uses_action
    assert np.isfinite([state.position, state.velocity, state.effort]).all()


@pytest.mark.parametrize("target", [[0.5, 0.1], {"joint2": -0.3}], ids=["all joints", "by name"])
def test_it_moves_to_a_posture(arm: Arm, target: list[float] | dict[str, float]) -> None:
    before = arm.state.desired[0]
    duration = arm.move_to(target)
    wanted = target if isinstance(target, list) else [before[0], target["joint2"]]
    assert duration > 0.0
    np.testing.assert_allclose(arm.state.desired[0], wanted, atol=1e-6)
    np.testing.assert_allclose(arm.state.position, wanted, atol=0.03)


def test_hold_ends_a_motion(arm: Arm) -> None:
    arm.move_to([0.0, 0.0])
    arm.move_to([1.0, 1.0], velocity_scale=0.2, wait=False)
    arm.hold()
    state = arm.state
    assert np.abs(state.desired[1]).max() < 1e-3
    assert state.desired[0].max() < 0.99


def test_a_stream_is_followed(arm: Arm) -> None:
    arm.move_to([0.0, 0.0])
    deadline, target = time.monotonic() + 30.0, 0.0
    # Where targets come late, the motion runs past the last one for a moment, and comes back with the next.
    while np.max(np.abs(arm.state.desired[0] - 0.1)) > 0.001 and time.monotonic() < deadline:
        target = min(target + 0.002, 0.1)
        arm.stream([target] * 2)
        time.sleep(0.02)
    np.testing.assert_allclose(arm.state.desired[0], 0.1, atol=0.001)
    arm.hold()


def test_what_is_not_possible_is_an_error(arm: Arm) -> None:
    with pytest.raises(ValueError, match="3 positions for 2 joints: joint1, joint2"):
        arm.move_to([0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="unknown joints elbow; expected: joint1, joint2"):
        arm.move_to({"elbow": 0.0})
    with pytest.raises(ValueError, match="velocity_scale 2: must be above 0 and at most 1"):
        arm.move_to([0.0, 0.0], velocity_scale=2.0)
    with pytest.raises(GoalError, match="not finite"):
        arm.move_to([math.nan, 0.0])
    with pytest.raises(GoalError, match="the log of the node has the reason"):
        arm.follow(JointTrajectory(joint_names=["joint2"]))
    arm.follow(
        JointTrajectory(joint_names=["joint1", "joint2"], points=[JointTrajectoryPoint(positions=[math.nan, 0.0])])
    )
    with pytest.raises(GoalError, match="not finite: joint1"):
        arm.wait(10.0)


def test_the_tool_goes_where_a_pose_says(arm: Arm, capfd: pytest.CaptureFixture[str]) -> None:
    arm.move_to([0.3, 0.6])
    start = arm.tool.position
    arm.move_to_pose(np.add(start, [-0.05, 0.0, 0.05]))
    np.testing.assert_allclose(arm.tool.position, np.add(start, [-0.05, 0.0, 0.05]), atol=1e-5)
    end = time.monotonic() + DEADLINE
    while np.abs(arm.tool.position - start).max() > 5e-4 or np.abs(arm.state.desired[1]).max() > 1e-3:
        assert time.monotonic() < end
        arm.stream_pose(start, [0.0, 0.0, 0.0, 1.0])
        time.sleep(0.02)  # The rate of the stream.
    arm.hold()
    np.testing.assert_allclose(arm.tool.position, start, atol=1e-3)
    words = [f"{x:.4f}" for x in np.add(start, [-0.05, 0.0, 0.0])]
    assert main(["move", "--pose", *words, "--robot", str(TWO_LINK.description)]) == 0
    np.testing.assert_allclose(arm.tool.position, np.add(start, [-0.05, 0.0, 0.0]), atol=2e-4)
    with pytest.raises(TargetError, match="zero quaternion"):
        arm.stream_pose(start, [0.0, 0.0, 0.0, 0.0])
    with pytest.raises(GoalError, match="cannot follow its path"):
        arm.move_to_pose(np.add(start, [5.0, 0.0, 0.0]))
    with pytest.raises(TargetError, match="unknown frame nowhere; expected"):
        arm.move_to_pose(start, frame="nowhere")
    assert main(["move", "--pose", "0.1"]) == 2
    assert "x y z and a quaternion" in capfd.readouterr().err


def test_the_example_draws_a_square(testbed: Testbed, monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", testbed.environment["ROS_DOMAIN_ID"])
    overrides = ["simulator.duration=0.0", "simulator.rate=250"]
    experiment = make_experiment(None, robot="panda", params=[PRACTICAL], overrides=overrides)
    for node, subscribers in ("simulator", 2), ("controller", 1), ("trajectory", 1):
        file = testbed.folder / f"{node}.yaml"
        values = {**node_parameters(experiment, "lockstep")[node], "start.subscribers": subscribers}
        file.write_text(ros_parameters(node, values), encoding="utf-8")
        testbed.processes.start(node, ["--params-file", str(file)], testbed.environment, testbed.folder / f"{node}.log")
    with Arm(timeout=60.0):
        pass  # The first nodes on a machine compile.
    runpy.run_path(str(EXAMPLE))
    tool = capfd.readouterr().out.partition("the tool is at")[2].strip(" []\n").split()
    np.testing.assert_allclose([float(x) for x in tool], CENTRE, atol=2e-3)


def test_without_a_system_there_is_no_arm(system: Testbed) -> None:
    with pytest.raises(ArmNotFoundError, match=r"no node trajectory in the namespace /elsewhere within 0\.3 s"):
        Arm("elsewhere", timeout=0.3)
    assert issubclass(ArmNotFoundError, ArmError)


def test_the_command_moves_the_arm(arm: Arm, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["move", "--to", "joint1=0.2", "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert result["desired"]["joint1"] == pytest.approx(0.2, abs=1e-6)
    assert arm.state.desired[0, 0] == pytest.approx(0.2, abs=1e-6)
    assert main(["move", "--to", "0.1"]) == 2
    assert "1 positions for 2 joints" in capfd.readouterr().err
    assert main(["move", "--to", "near"]) == 2
