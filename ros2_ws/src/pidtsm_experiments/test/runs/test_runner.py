"""Parameters of the nodes of a run."""

import json
from pathlib import Path

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.node_parameters import NODE_ONLY, NODE_SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots import find_robot
from pidtsm_experiments.runs.runner import bag_metadata, node_parameters


def test_a_rollout_gets_all_that_changes_a_torque(tmp_path: Path) -> None:
    """Only parameters that exist in nodes alone are omitted."""
    everything = node_parameters(make_experiment("case1"), "lockstep")
    params = tmp_path / "all.yaml"
    params.write_text("".join(ros_parameters(node, values) for node, values in everything.items()))
    left = make_experiment("case1", params=[str(params)]).values
    for node, values in everything.items():
        assert set(values) - set(left[node]) == {p.name for p in NODE_ONLY[node]}


def test_the_metadata_contains_the_parameters_of_the_trajectory() -> None:
    experiment = make_experiment("case1", overrides=["trajectory.jump.position=[0.1, 0.2]"])
    known = json.loads(bag_metadata(experiment, "lockstep"))["trajectory"]
    expected = node_parameters(experiment, "lockstep")["trajectory"]
    assert resolve(NODE_SCHEMAS["trajectory"], known, 2) == expected


def test_the_metadata_contains_the_arm() -> None:
    known = json.loads(bag_metadata(make_experiment(None, robot="scara"), "lockstep"))
    assert find_robot(known["robot"]).joints == ("joint1", "joint2", "joint3", "joint4")
    assert known["sliding"] == ["joint3"]
