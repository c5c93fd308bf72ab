"""Random goals for real nodes: none is lost, late or rough, also with a payload that the controller does not know."""

import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from goals import soak  # noqa: E402
from support.rig import document_rows  # noqa: E402

from pidtsm_core.robots import find_robot  # noqa: E402
from pidtsm_core.trajectories.tracking import Code  # noqa: E402

PAGE = ROOT / "docs" / "moveit.md"
PAYLOADS = ROOT / "ros2_ws/src/pidtsm_core/pidtsm_core/robots/arms/payloads.yaml"
ONE_OF_EACH = 8
"""Seed with which, of five goals, one is cancelled, one replaced, and one bad."""


def test_random_goals_end_as_they_should(tmp_path: Path) -> None:
    """With the default tolerances: 0.05 rad on the way, 0.03 rad at the goal."""
    rated = yaml.safe_load(PAYLOADS.read_text(encoding="utf-8"))["panda"]["payload"]
    found = soak(tmp_path, "panda", 0.4 * rated, goals=5, seed=ONE_OF_EACH)
    assert found["lost"] == 0
    assert found["unexpected"] == []
    assert sum(found["outcomes"].values()) == 6, found["outcomes"]
    assert found["worst_duration_ratio"] <= 1.2, "MoveIt's allowance"
    assert found["largest_torque_step_beyond_the_model"] <= 10.0
    assert found["largest_jerk_as_a_share_of_the_limit"] == pytest.approx(1.0, abs=1e-3), "that of a stop"


def test_the_settings_of_moveit_name_the_joints_of_the_panda_and_the_action() -> None:
    text = (
        PAGE.read_text(encoding="utf-8").partition('```yaml title="moveit_controllers.yaml"\n')[2].partition("```")[0]
    )
    manager = yaml.safe_load(text)["moveit_simple_controller_manager"]
    assert manager["controller_names"] == ["trajectory"]
    assert manager["trajectory"]["action_ns"] == "follow_joint_trajectory"
    assert tuple(manager["trajectory"]["joints"]) == find_robot({"robot.description": "panda"}).joints


def test_the_page_explains_every_error_code() -> None:
    assert document_rows(PAGE, "Error codes") == [str(code.value) for code in Code]
