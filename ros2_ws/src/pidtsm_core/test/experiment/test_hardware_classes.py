"""Classes of hardware: data that fit every arm."""

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.hardware_classes import hardware_content, hardware_names, hardware_settings
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.source import ARMS
from pidtsm_core.rollouts.closed_loop import rollout


@pytest.mark.parametrize("name", hardware_names())
@pytest.mark.parametrize("arm", [None, *ARMS])
def test_every_arm_can_have_every_class(arm: str | None, name: str) -> None:
    values = make_experiment(None, robot=arm, hardware=name).values["simulator"]
    content, limits = hardware_content(name), np.array(find_robot(values).effort_limit)
    for parameter, value in content["simulator"].items():
        assert values[parameter] == value
    assert np.array(values["friction.coulomb"]) == pytest.approx(content["relative"]["friction.coulomb"] * limits)


def test_joints_that_slide_stay_rigid() -> None:
    stiffness = hardware_settings("geared", {"robot.description": "scara"})["elasticity.stiffness"]
    slides = find_robot({"robot.description": "scara"}).slides
    assert [value == 0.0 for value in stiffness] == list(slides)


def test_limits_that_are_set_scale_the_class() -> None:
    simulator = {"robot.description": "ur5", "limits.effort": 10.0}
    assert hardware_settings("geared", simulator)["friction.coulomb"] == pytest.approx([1.0] * 6)


def test_parameters_and_overrides_are_stronger() -> None:
    made = make_experiment(None, robot="panda", hardware="hobby", overrides=["simulator.encoder.bits=9"])
    assert made.settings["simulator"]["encoder.bits"] == 9
    assert made.settings["simulator"]["rate"] == 200


def test_an_unknown_class_is_refused_with_those_that_exist() -> None:
    with pytest.raises(UsageError, match=r"collaborative, direct_drive, geared, hobby; did you mean geared\?"):
        make_experiment(None, hardware="gearde")


def test_a_recording_shows_which_side_it_is_of() -> None:
    elastic = rollout(make_experiment("case1", duration=0.01, hardware="geared", params="practical"))
    assert elastic.metrics()["side"] == "link"
    assert rollout(duration=0.01).metrics()["side"] == ""
