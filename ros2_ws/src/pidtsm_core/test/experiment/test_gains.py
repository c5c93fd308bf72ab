"""The first gains of an arm keep what they promise, and follow from its sensors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from support.testarms import CRANE

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL, PRACTICAL_FILE, make_experiment
from pidtsm_core.experiment.gains import first_gains
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import resolve
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_core.robots import robot_joints
from pidtsm_core.robots.source import ARMS, rated_payload
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Status


def value(robot: str, name: str, **sensors: Any) -> Array:
    (found,) = (gain.value for gain in first_gains({"robot.description": robot}, **sensors) if gain.name == name)
    return np.array(found)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(("bits", "delay"), [(12, 1), (14, 5), (17, 10)])
@pytest.mark.parametrize("error", [-0.2, 0.2])
def test_they_suit_the_sensors_whatever_the_load(arm: str, bits: int, delay: int, error: float) -> None:
    gains = {gain.name: gain.value for gain in first_gains({"robot.description": arm}, bits, delay * 1e-3)}
    simulator = {
        "encoder.bits": bits,
        "delay.samples": delay,
        "model_error.mass": error,
        "model_error.inertia": error,
        "payload.mass": 0.4 * rated_payload(arm),
        "payload.time": 2.0,
    }
    run = rollout(robot=arm, duration=5.0, controller=gains, simulator=simulator)
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(run.position - run.reference[:, 0])[4000:].max() < 6e-3
    assert np.abs(np.diff(run.effort[4000:], axis=0)).mean(axis=0).max() < 0.3


@pytest.mark.parametrize("arm", [*ARMS, "two_link"])
@pytest.mark.parametrize("law", LAWS.names)
def test_practical_suits_every_law_on_every_arm(arm: str, law: str) -> None:
    """With 14-bit encoders and 1 ms of delay, and the friction of the arm, which PID has no model of."""
    sensors = {"encoder.bits": 14, "delay.samples": 1}
    run = rollout(None, law, PRACTICAL, arm, duration=6.0, simulator=sensors)
    assert not run.status[:, Status.FAULT].any()
    # What knows no model begins anew where friction reverses.
    assert np.abs(run.error[run.time >= 4.0]).max() < (5e-3 if LAWS[law].uses_model or law == "pid" else 1e-2)
    limits = np.abs(run.effort).max(axis=0)
    assert (np.abs(np.diff(run.effort[4000:], axis=0)).mean(axis=0) < 0.01 * limits + 0.2).all()


@given(bits=st.integers(8, 24), delay=st.floats(0.0, 0.05), rate=st.floats(100.0, 4000.0))
def test_worse_sensors_never_make_the_observer_faster(bits: int, delay: float, rate: float) -> None:
    def bandwidth(**sensors: Any) -> Array:
        return value("panda", "estimator.bandwidth", **sensors)

    here = bandwidth(bits=bits, delay=delay, rate=rate)
    assert (bandwidth(bits=bits - 1, delay=delay, rate=rate) <= here).all()
    assert (bandwidth(bits=bits, delay=delay + 0.01, rate=rate) <= here).all()
    assert (bandwidth(bits=bits, delay=delay, rate=0.5 * rate) <= here).all()
    assert (here > 0.0).all()


def test_heavier_rotors_make_it_slower() -> None:
    light, heavy = (
        {g.name: g.value for g in first_gains({"robot.description": "panda", "robot.armature": rotor})}
        for rotor in (0.1, 2.0)
    )
    assert (np.array(heavy["estimator.bandwidth"]) < np.array(light["estimator.bandwidth"])).all()


@pytest.mark.parametrize("arm", [*ARMS, "two_link"])
@pytest.mark.parametrize("bits", [0, 14])
@pytest.mark.parametrize("law", LAWS.names)
def test_every_gain_is_a_parameter_and_has_a_reason(arm: str, bits: int, law: str) -> None:
    robot = {"robot.description": arm}
    gains = first_gains(robot, bits, law=law)
    resolve(controller_schema, {**robot, **{g.name: g.value for g in gains}}, robot_joints(robot))
    assert all(gain.reason for gain in gains)
    assert len({gain.name for gain in gains}) == len(gains)


def test_a_law_without_a_rule_is_refused_with_those_that_have_one() -> None:
    with pytest.raises(UsageError, match=r"no rule for the gains of mine, only for piddtsm, .*; set its parameters"):
        first_gains({"robot.description": "panda"}, law="mine")


def test_for_the_arm_of_the_article_they_are_near_those_tuned_by_hand() -> None:
    tuned = load_ros_parameters(PRACTICAL_FILE)["controller"]
    for name, factor in (("estimator.bandwidth", 1.4), ("law.upsilon", 5.0)):
        ratio = value("two_link", name) / np.array(tuned[name])
        assert (1.0 / factor < ratio).all()
        assert (ratio < factor).all()


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "arm.urdf"
    path.write_text(str(CRANE.settings["robot.description"]))
    return str(path)


@pytest.mark.parametrize("law", LAWS.names)
def test_an_arm_from_a_file_has_them_by_default(file: str, law: str) -> None:
    without, with_them = (make_experiment(None, law, params=params, robot=file) for params in ((), (PRACTICAL,)))
    by_parameter = make_experiment(None, overrides=[f"controller.law.name={law}"], robot=file)
    assert without.settings == with_them.settings == by_parameter.settings
    one = make_experiment(None, law, overrides={"controller": {"law.anti_windup": "none"}}, robot=file)
    assert one.settings["controller"] == {**without.settings["controller"], "law.anti_windup": "none"}


def test_it_has_them_in_a_scenario(tmp_path: Path, file: str) -> None:
    nodes = {node: {"robot.description": file} for node in ("simulator", "controller")}
    nodes["trajectory"] = {"reference.name": "minimum_jerk"}
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(yaml.safe_dump({"description": "an arm", "duration": 1.0, **nodes}))
    found, expected = make_experiment(str(scenario)), make_experiment(None, params=PRACTICAL, robot=file)
    assert {**found.settings["controller"], "joints": None} == {**expected.settings["controller"], "joints": None}
    of_the_article = make_experiment(str(scenario), params="article").settings["controller"]
    assert "estimator.bandwidth" not in of_the_article


def test_other_gains_are_those_that_are_requested(file: str) -> None:
    of_the_article = make_experiment(None, params=["article"], robot=file)
    assert "estimator.bandwidth" not in of_the_article.settings["controller"]
    differentiated = make_experiment(None, overrides=["controller.estimator.name=exact"], robot=file)
    assert "estimator.bandwidth" not in differentiated.settings["controller"]
    assert "law.kp" not in make_experiment(None, robot="panda").settings["controller"]
