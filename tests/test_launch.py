"""The launch file starts the system that ``./pidtsm run`` with the same arguments would start."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from support.launching import PROGRAM
from support.testbed import DEADLINE, Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.reader import read_recording

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed: the wheels have none"
)

LAUNCH_FILE = Path(get_package_share_directory("pidtsm_experiments"), "launch", "arm.launch.py")


PARENT = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
def generate_launch_description():
    included = IncludeLaunchDescription({ours!r}, launch_arguments=[("clock", "lockstep"), ("duration", "0.1")])
    return LaunchDescription([DeclareLaunchArgument("camera"), included])
"""


def launch(testbed: Testbed, *arguments: str, file: Path = LAUNCH_FILE) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", PROGRAM, str(file), *arguments]
    return subprocess.run(
        command, env=testbed.environment, cwd=testbed.folder, capture_output=True, text=True, timeout=DEADLINE
    )


def test_arguments_mean_what_options_mean(testbed: Testbed) -> None:
    done = launch(
        testbed,
        "namespace:=left",
        "clock:=lockstep",
        "duration:=0.5",
        "record:=bag",
        "law:=pidnftsm",
        "params:=article",
        "set:=simulator.payload.mass=1.0 controller.law.k1='[2.0, 3.0]'",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    recording = read_recording(testbed.folder / "bag")
    overrides = ["simulator.payload.mass=1.0", "controller.law.k1=[2.0, 3.0]"]
    experiment = make_experiment("case1", "pidnftsm", 0.5, ["article"], overrides)
    np.testing.assert_array_equal(recording.effort, rollout(experiment, duration=0.5).effort)


@pytest.mark.parametrize("clock", ["realtime", "lockstep"])
def test_an_ordinary_end_shows_no_error(testbed: Testbed, clock: str) -> None:
    done = launch(testbed, f"clock:={clock}", "duration:=1.0", "record:=bag")
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert output.count("process has finished cleanly") == 4, output
    assert "ERROR" not in output
    assert output.index("[controller-2]: process has finished") < output.index("SIGINT' to process[recorder-4]"), output


def test_a_launch_ends_with_its_recorder(testbed: Testbed) -> None:
    """Else the simulator would wait for it for ever."""
    done = launch(testbed, "record:=/proc/bag", "set:=simulator.duration=0.0")
    output = done.stdout + done.stderr
    assert "cannot record: /proc/bag" in output
    assert output.count("process has finished cleanly") == 3, output


def test_two_arms_run_beside_each_other(testbed: Testbed) -> None:
    both = LAUNCH_FILE.with_stem("two_arms.launch")
    done = launch(testbed, "duration:=1.0", "left_set:=controller.law.kd=0.6", file=both)
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    for side in ("left", "right"):
        assert f"[{side}.controller]: following the reference" in output, output
    assert output.count("process has finished cleanly") == 8, output


def refused(testbed: Testbed, argument: str) -> str:
    """Output of a launch that starts nothing."""
    done = launch(testbed, argument)
    assert done.returncode == 1
    assert "process started" not in done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize(
    ("argument", "cause"),
    [
        ("law:=nonsense", "unknown law nonsense; known: "),
        ("durations:=1.0", "unknown argument durations; known: scenario, law, robot, engine, duration, clock"),
        ("duration:=abc", "duration: 'abc' is not a positive number of seconds"),
        ("duration:=-1", "duration: '-1' is not a positive number of seconds"),
        ("clock:=sundial", "clock: 'sundial' must be one of realtime, lockstep"),
        ("viewer:=eyes", "viewer: 'eyes' must be one of none, rviz"),
        ("autostart:=maybe", "autostart: 'maybe' must be one of true, false"),
        ("scenario:=nonsense", "no scenario nonsense: neither a file nor one of case1"),
        ("robot:=snake", "robot.description: snake: No such file or directory; neither a file nor one of two_link"),
        ("set:=controller.law.kk=1.0", "controller: unknown parameter law.kk; did you mean law.k?"),
        ("set:='a", "set: 'a: No closing quotation"),
        ("params:=nowhere.yaml", "nowhere.yaml: No such file or directory"),
        ("namespace:=1st", "namespace: '1st': Invalid namespace: namespace must not have a token that starts with"),
        ("record:=/tmp", "record: /tmp exists; specify a new folder"),
    ],
)
def test_a_bad_argument_starts_nothing_and_is_one_line(testbed: Testbed, argument: str, cause: str) -> None:
    errors = [line for line in refused(testbed, argument).splitlines() if "INFO" not in line]
    assert len(errors) == 1, errors
    assert cause in errors[0]


def test_a_launch_file_that_includes_ours_has_arguments_of_its_own(testbed: Testbed) -> None:
    parent = testbed.folder / "parent.launch.py"
    parent.write_text(PARENT.format(ours=str(LAUNCH_FILE)))
    done = launch(testbed, "camera:=left", file=parent)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "done: 100 samples" in done.stdout + done.stderr


def test_rviz_and_the_visualization_show_the_robot(testbed: Testbed) -> None:
    prefix = testbed.folder / "prefix"
    rviz, index = prefix / "lib" / "rviz2" / "rviz2", prefix / "share" / "ament_index" / "resource_index" / "packages"
    for folder in (rviz.parent, index):
        folder.mkdir(parents=True)
    (index / "rviz2").touch()
    rviz.write_text('#!/bin/sh\necho "RViz: $*" >&2\nexec sleep 60\n')  # Stands in for a window.
    rviz.chmod(0o755)
    testbed.environment["AMENT_PREFIX_PATH"] = f"{prefix}:{testbed.environment['AMENT_PREFIX_PATH']}"
    done = launch(testbed, "robot:=panda", "clock:=lockstep", "duration:=0.2", "viewer:=rviz")
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert "arm.rviz -f world" in output, output
    assert "[visualization]: the fixed frame is world" in output, output


@pytest.mark.skipif(shutil.which("rviz2") is not None, reason="RViz is installed")
def test_without_rviz_nothing_starts_either(testbed: Testbed) -> None:
    assert "package 'rviz2' not found" in refused(testbed, "viewer:=rviz")
