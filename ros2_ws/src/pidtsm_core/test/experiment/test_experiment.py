"""Scenarios, parameter files and options become the parameters of the nodes."""

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pidtsm_core
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment, scenario_names
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS, SCHEMAS
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.parameters.files import load_ros_parameters


@pytest.mark.parametrize(("text", "value"), [("1e-3", 0.001), ("-2E+1", -20.0), ("1.5e-3", 0.0015), ("5", 5)])
def test_numbers_may_have_exponents(tmp_path: Path, text: str, value: float) -> None:
    by_option = make_experiment("case1", overrides=[f"simulator.encoder.bias={text}"])
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(f"duration: 1.0\nsimulator: {{encoder.bias: [{text}, {text}]}}\n")
    assert by_option.settings["simulator"]["encoder.bias"] == value
    assert make_experiment(str(scenario)).settings["simulator"]["encoder.bias"] == [value, value]


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_is_accepted(name: str) -> None:
    assert make_experiment(name).values


def test_an_arm_chosen_by_parameters_has_its_motion_as_one_chosen_by_name() -> None:
    chosen = {node: {"robot.description": "panda"} for node in ("simulator", "controller")}
    by_name, by_parameters = make_experiment(None, robot="panda"), make_experiment(None, overrides=chosen)
    assert by_parameters.settings == by_name.settings
    assert (by_parameters.scenario, by_parameters.duration) == (by_name.scenario, by_name.duration)


@pytest.mark.parametrize("node", ["simulator", "controller"])
def test_arms_that_differ_between_nodes_are_refused(node: str) -> None:
    with pytest.raises(ParameterError, match="joints"):
        make_experiment(None, overrides={node: {"robot.description": "panda"}})


def write_layers(folder: Path) -> tuple[str, str]:
    """A scenario and a parameter file that contradict each other."""
    scenario, params = folder / "scenario.yaml", folder / "params.yaml"
    scenario.write_text("duration: 1.0\ncontroller: {law: {name: dtsm, k1: 1.0, k2: 1.0}, activation.blend: 1.0}\n")
    params.write_text("controller: {ros__parameters: {law: {name: pidnftsm, k1: 2.0}, activation.blend: 2.0}}\n")
    return str(scenario), str(params)


def test_later_settings_win_scenario_parameter_file_law_option(tmp_path: Path) -> None:
    scenario, params = write_layers(tmp_path)
    of_scenario = make_experiment(scenario).settings["controller"]
    assert of_scenario == {"law.name": "dtsm", "law.k1": 1.0, "law.k2": 1.0, "activation.blend": 1.0}
    of_file = make_experiment(scenario, params=[params])
    assert of_file.law == "pidnftsm"
    assert of_file.settings["controller"] == {
        "law.name": "pidnftsm",
        "law.k1": 2.0,
        "law.k2": 1.0,
        "activation.blend": 2.0,
    }
    by_law = make_experiment(scenario, "piddtsm", params=[params])
    assert by_law.law == "piddtsm"
    by_option = make_experiment(
        scenario, "piddtsm", params=[params], overrides=["controller.law.name=dtsm", "controller.law.k1=3.0"]
    )
    assert by_option.law == "dtsm"
    assert by_option.settings["controller"]["law.k1"] == 3.0


def test_an_experiment_is_checked_when_it_is_made_and_stays_what_it_was() -> None:
    with pytest.raises(ParameterError, match=r"controller: law\.k1"):
        make_experiment("case1", overrides=["controller.law.k1=-3.0"])
    experiment = make_experiment("case1", overrides=["controller.law.k1=3.5"])
    with pytest.raises(TypeError):
        experiment.settings["controller"]["law.k1"] = 4.0  # type: ignore[index]
    experiment.values["controller"]["law.k1"] = 4.0
    assert json.loads(json.dumps(experiment.values))["controller"]["law.k1"] == 3.5
    assert make_experiment(experiment) is experiment
    again = pickle.loads(pickle.dumps(experiment))
    assert again == experiment
    assert again.values == experiment.values
    assert replace(experiment, settings={}).values["controller"]["law.k1"] != 3.5


def test_the_error_of_a_refused_value_names_the_file_that_set_it(tmp_path: Path) -> None:
    scenario, params = write_layers(tmp_path)
    Path(params).write_text("controller: {ros__parameters: {activation.blend: -1.0}}\n")
    with pytest.raises(UsageError, match=r"params.yaml: controller: activation.blend"):
        make_experiment(scenario, params=[params])


def test_a_named_set_is_that_of_the_law_of_the_scenario(tmp_path: Path) -> None:
    scenario, _ = write_layers(tmp_path)
    experiment = make_experiment(scenario, params=["article"])
    assert experiment.law == "dtsm"
    assert experiment.settings["controller"]["law.kappa"] == 0.3
    practical = make_experiment(scenario, params=["practical"])
    assert practical.law == practical.settings["controller"]["law.name"] == "dtsm"
    assert "law.ki" not in practical.settings["controller"]


@pytest.mark.parametrize("schemas", [SCHEMAS, NODE_SCHEMAS], ids=["rollout", "nodes"])
@pytest.mark.parametrize(
    ("node", "settings", "cause"),
    [
        (
            "controller",
            {"estimator.bandwidth": 30},
            "bandwidth belongs to estimator.name elastic_joint_observer or",
        ),
        (
            "controller",
            {"law.gain": 1},
            "gain belongs to law.name integral_sliding_mode, sliding_mode or super_twisting",
        ),
        ("controller", {"law.decay": 1}, "decay belongs to law.name sliding_mode and law.reaching exponential"),
        (
            "controller",
            {"law.name": "sliding_mode", "law.manifold": "none", "law.kd": 1},
            "kd belongs to law.name .*; or law.manifold pid",
        ),
        ("controller", {"law.name": "pid", "law.alpha": 1}, "alpha belongs to law.name dtsm or piddtsm"),
        ("trajectory", {"reference.file": "x"}, "file belongs to reference.name csv"),
        ("controller", {"law.kk": 1}, r"unknown parameter law.kk; did you mean law.k\?"),
    ],
)
def test_the_error_of_a_parameter_of_another_choice_names_that_choice(
    schemas: Any, node: str, settings: dict[str, Any], cause: str
) -> None:
    with pytest.raises(ParameterError, match=cause):
        resolve(schemas[node], settings, 2)


@pytest.mark.parametrize("backward", [False, True])
def test_the_trajectory_has_the_arm_and_the_limits_of_the_controller(backward: bool) -> None:
    joints = [f"panda_joint{i}" for i in range(1, 8)]
    order = joints[::-1] if backward else joints
    velocity = [0.1 * (i + 1) for i in range(7)]
    own = {"joints": order} if backward else {}
    values = make_experiment(
        None, robot="panda", overrides={"controller": {"limits.velocity": velocity}, "trajectory": own}
    ).node_values({})["trajectory"]
    assert values["robot.description"] == "panda"
    assert values["joints"] == tuple(order)
    assert values["limits.velocity"] == tuple(velocity[::-1] if backward else velocity)
    assert values["limits.effort"] == (*[12.0] * 3, *[87.0] * 4)[:: 1 if backward else -1]
    other = make_experiment(None, robot="panda", overrides={"trajectory": {"robot.description": "", **own}})
    assert other.node_values({})["trajectory"]["robot.description"] == ""


@pytest.mark.parametrize("joints", [[[True], "joint2"], ["joint1", 2], {"joint1": 1}, None])
def test_joints_of_the_trajectory_that_are_no_names_are_refused(joints: Any) -> None:
    with pytest.raises(ParameterError, match="joints"):
        make_experiment(None, overrides={"trajectory": {"joints": joints}}).node_values({})


def test_a_closed_form_is_shared_only_in_the_order_of_its_joints() -> None:
    swapped = make_experiment(None, overrides={"trajectory": {"joints": ["joint2", "joint1"]}})
    for experiment, description in ((make_experiment(None), "two_link"), (swapped, "")):
        assert experiment.node_values({})["trajectory"]["robot.description"] == description


TUNED = sorted((Path(pidtsm_core.__file__).parent / "experiment" / "params" / "tuned").glob("*.yaml"))


@pytest.mark.parametrize("file", TUNED, ids=lambda file: file.stem)
def test_every_tuned_set_is_chosen_by_its_hardware_and_accepted(file: Path) -> None:
    robot, _, hardware = file.stem.rpartition("-")
    experiment = make_experiment(None, robot=robot, params=[f"tuned_{hardware}"])
    assert experiment.values
    first, _, unseen = file.read_text().splitlines()[:3]
    assert first.startswith(f"# ./pidtsm tune --robot {robot} --law piddtsm --hardware {hardware} --objective ")
    before, after = re.findall(r"(\S+) (?:before|after)", unseen)
    assert float(after) < float(before)
    law = load_ros_parameters(file)["controller"]
    assert law.items() <= experiment.settings["controller"].items()


@pytest.mark.parametrize(
    ("robot", "law", "name"),
    [("two_link", None, "tuned_20bit"), ("two_link", "pid", "tuned_ideal"), ("arm.urdf", None, "tuned_ideal")],
)
def test_a_tuned_set_that_does_not_exist_is_refused(robot: str, law: str | None, name: str) -> None:
    controller = {"controller": {"robot.description": robot}, "simulator": {"robot.description": robot}}
    with pytest.raises(UsageError, match=rf"no set {name} for .* two_link-(ideal|direct_drive)"):
        make_experiment("case1", law, params=[name], overrides=controller)


@pytest.mark.parametrize("law", [law for law in LAWS.names if law != "impedance"])
def test_every_law_has_the_sets_practical_and_tuned_by_name(law: str) -> None:
    """Impedance is not meant to track, and was in no tournament."""
    for name in ("practical", "tuned", "tuned_direct_drive"):
        experiment = make_experiment("case1", law, 0.1, name)
        assert experiment.values["controller"]["law.name"] == law
        assert any(file.endswith((f"-{law}.yaml", "practical.yaml", "practical")) for file in experiment.files.values())
    with pytest.raises(UsageError, match=f"no set tuned for {law} on xarm7; .*there are .*two_link-direct_drive-{law}"):
        make_experiment(None, law, 0.1, "tuned", robot="xarm7")
