"""What each arm is scored on suits the arm."""

from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import NAMES
from pidtsm_core.robots.source import rated_payload
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.score.tasks import effort_limits, find_task

ARM = """<robot name="pendulum"><link name="base"/><link name="bob"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tool"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="30" velocity="3"/></joint>
<joint name="end" type="fixed"><origin xyz="1 0 0"/><parent link="bob"/><child link="tool"/></joint></robot>"""


@pytest.mark.parametrize("robot", NAMES)
def test_the_events_of_a_run_are_over_when_it_is_judged(robot: str) -> None:
    task = find_task(robot)
    assert task.event + 1.1 < task.after < task.duration
    assert task.payload == (4.0 if robot == "two_link" else rated_payload(robot))
    task.experiment("computed_torque")


def test_an_arm_from_a_file_is_loaded_with_what_its_joints_can_hold(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.urdf"
    file.write_text(ARM)
    task = find_task(str(file))
    # 30 N m hold 2 kg at 0.5 m and the payload at 1 m.
    assert task.payload == pytest.approx(30.0 / 9.81 - 1.0, rel=0.05)
    experiment = task.experiment(None, ("practical",))
    np.testing.assert_array_equal(effort_limits(experiment.values["simulator"]), [30.0])
    assert rollout(experiment, duration=0.1).time.size == 100


def test_a_controller_that_is_refused_is_an_error() -> None:
    with pytest.raises(ParameterError, match=r"unknown parameter law\.k9"):
        find_task().experiment(None, (), ("controller.law.k9=1",))
