"""The launch file starts the system that ``./pidtsm run`` with the same arguments would start."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from bench import DEADLINE, Bench

from pidtsm_core.rollout import rollout
from pidtsm_experiments.experiment import make_experiment
from pidtsm_experiments.recording import read_recording

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed: the wheels have none"
)

LAUNCH_FILE = Path(get_package_share_directory("pidtsm_experiments"), "launch", "two_link.launch.py")
# What `ros2 launch` does; ros2 itself need not be there.
PROGRAM = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
arguments = [word.split(":=", 1) for word in sys.argv[2:]]
service = LaunchService(noninteractive=True)
included = IncludeLaunchDescription(sys.argv[1], launch_arguments=arguments)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


def launch(bench: Bench, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", PROGRAM, str(LAUNCH_FILE), *arguments]
    return subprocess.run(
        command, env=bench.environment, cwd=bench.folder, capture_output=True, text=True, timeout=DEADLINE
    )


def test_arguments_mean_what_options_mean(bench: Bench) -> None:
    done = launch(
        bench,
        "namespace:=left",
        "clock:=lockstep",
        "duration:=0.5",
        "record:=bag",
        "law:=pidnftsm",
        "params:=article",
        "set:=simulator.payload.mass=1.0 controller.law.k1='[2.0, 3.0]'",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    recording = read_recording(bench.folder / "bag")
    overrides = ["simulator.payload.mass=1.0", "controller.law.k1=[2.0, 3.0]"]
    experiment = make_experiment("case1", "pidnftsm", 0.5, ["article"], overrides)
    np.testing.assert_array_equal(recording.effort, rollout(experiment.settings, 0.5).effort)


def refused(bench: Bench, argument: str) -> str:
    """What a launch says that starts nothing."""
    done = launch(bench, argument)
    assert done.returncode == 1
    assert "process started" not in done.stdout + done.stderr
    return done.stdout + done.stderr


def test_bad_arguments_start_nothing(bench: Bench) -> None:
    assert "unknown law nonsense; known are" in refused(bench, "law:=nonsense")


@pytest.mark.skipif(shutil.which("rviz2") is not None, reason="RViz is installed")
def test_without_rviz_nothing_starts_either(bench: Bench) -> None:
    assert "package 'rviz2' not found" in refused(bench, "viewer:=rviz")
