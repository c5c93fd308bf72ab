"""Both engines simulate the same arm: how far they differ, with which integrator and with which friction."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots import NAMES
from pidtsm_core.written import quantity
from pidtsm_studies.engines import EngineComparison, as_json, compare_engines, write_engine_page

SMOOTH = {"simulator": {"friction.coulomb": 0.0}, "controller": {"compensation.coulomb": 0.0}}
"""Without dry friction, which MuJoCo holds over a step, and which the controller would compensate."""


def compared(robot: str, duration: float, **simulator: Any) -> EngineComparison:
    dry = simulator.pop("dry", False)
    overrides: dict[str, dict[str, Any]] = {} if dry else {node: dict(each) for node, each in SMOOTH.items()}
    overrides.setdefault("simulator", {}).update({"engine": "mujoco", **simulator})
    return compare_engines(make_experiment(None, None, duration, robot=robot, overrides=overrides))


@pytest.mark.parametrize("robot", NAMES)
def test_both_engines_give_the_same_run(robot: str) -> None:
    comparison = compared(robot, 10.0)
    assert np.abs(comparison.relative("rmse")).max() < 1e-4
    assert np.abs(comparison.relative("eci")).max() < 1e-4
    assert comparison.difference.max() < 1e-5


@pytest.mark.parametrize("robot", ["two_link", "panda", "scara"])
@pytest.mark.parametrize(
    ("changes", "largest"),
    [
        ({"mujoco.timestep": 0.00025}, 1e-5),
        ({"mujoco.integrator": "euler"}, 1e-3),
        ({"friction.coulomb": 1.0, "dry": True}, 1e-3),
    ],
    ids=["fine", "euler", "dry friction"],
)
def test_integrator_step_and_friction_matter_little(robot: str, changes: dict[str, Any], largest: float) -> None:
    comparison = compared(robot, 3.0, **changes)
    assert 0.0 < comparison.difference.max() < largest
    assert np.abs(comparison.relative("eci")).max() < 0.01


def test_the_page_begins_with_how_far_apart_the_engines_are(tmp_path: Path) -> None:
    comparison = compared("scara", 0.2)
    write_engine_page(comparison, tmp_path / "page.html", {})
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    sample, joint = np.unravel_index(np.argmax(comparison.difference), comparison.difference.shape)
    run = next(iter(comparison.runs.values()))
    far = quantity(float(comparison.difference[sample, joint]), run.units[joint].position)
    assert f"The runs differ by at most {far}, in the position of {run.joints[joint]}" in text
    assert "How far apart are they?" in text
    assert "Which follows best?" not in text


def test_the_json_has_every_joint() -> None:
    content = json.loads(json.dumps(as_json(compared("scara", 0.2)), allow_nan=False))
    joints = len(content["joints"])
    lists = [content["largest_difference"], *content["rmse"].values(), *content["eci"].values()]
    assert all(len(values) == joints for values in lists)
    assert list(content["rmse"]) == ["rigid_body", "mujoco", "relative_difference"]
