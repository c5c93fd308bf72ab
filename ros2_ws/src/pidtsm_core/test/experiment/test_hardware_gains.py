"""The rule of gains takes the class of hardware into account, so that every arm follows."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, Experiment, make_experiment
from pidtsm_core.experiment.gains import first_gains
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.experiment.law_gains import Gain
from pidtsm_core.parameters import ParameterError, Value, as_float, joint_array
from pidtsm_core.parameters.files import Settings
from pidtsm_core.robots.source import ARMS
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Status


@cache
def _made(arm: str, hardware: str) -> Experiment:
    """The arm with the gains of the rule, made once: finding them takes longer than a rollout."""
    return make_experiment(None, robot=arm, hardware=hardware)


@cache
def _rigid_gains(arm: str, hardware: str, effort_rate: float = 0.0) -> Mapping[str, Value]:
    """Those of an observer that does not know the springs; `effort_rate`: its limit, N m/s; 0: none."""
    settings = _made(arm, hardware).settings
    gains = hardware_gains(
        {**settings["controller"], "limits.effort_rate": effort_rate}, settings["simulator"], knows_springs=False
    )
    return MappingProxyType({gain.name: gain.value for gain in gains} | {"drive.delay": 0.0})


@pytest.mark.parametrize("hardware", hardware_names())
def test_every_arm_follows_stably(hardware: str) -> None:
    for arm in ARMS:
        run = rollout(_made(arm, hardware), duration=8.0)
        late = run.time >= 4.0
        assert not run.status[:, Status.FAULT].any(), arm
        assert np.abs(run.error[late]).max() < 0.1, arm
        # No vibration: the links move as smoothly as the motion demands.
        assert np.abs(np.diff(run.commanded_effort[late], axis=0)).mean() < 0.01 * np.abs(run.effort).max(), arm


def test_gains_that_are_named_are_used() -> None:
    with_class, named = (make_experiment(None, robot="panda", hardware="geared", params=p) for p in ((), PRACTICAL))
    assert with_class.settings == named.settings
    tuned = make_experiment(None, robot="panda", hardware="geared", params="tuned_14bit").settings["controller"]
    without = make_experiment(None, robot="panda", params="tuned_14bit").settings["controller"]
    assert tuned == without
    differentiated = make_experiment(
        None, robot="panda", hardware="geared", overrides=["controller.estimator.name=exact"]
    )
    assert "estimator.bandwidth" not in differentiated.settings["controller"]


@pytest.mark.parametrize("hardware", ["geared", "collaborative"])
def test_an_observer_that_knows_the_springs_lets_links_err_by_half_as_much(hardware: str) -> None:
    ratios = []
    for arm in ARMS:
        ratios.append(_error(_made(arm, hardware)) / _error(_rigid(arm, hardware)))
    assert np.median(ratios) < 0.5, ratios
    assert max(ratios) < 1.25, ratios


def _error(experiment: Experiment) -> float:
    """RMS error of the links from 4 s on, rad; the largest one depends on when a joint slips."""
    run = rollout(experiment)
    assert not run.status[:, Status.FAULT].any()
    return float(np.sqrt(np.square(run.error[run.time >= 4.0]).mean()))


def _rigid(arm: str, hardware: str, condition: Settings | None = None) -> Experiment:
    """The arm with an observer that does not know the springs."""
    given = condition or {}
    settings = make_experiment(None, robot=arm, hardware=hardware, overrides=given).settings
    others = {name: value for name, value in settings["controller"].items() if not name.startswith("estimator.")}
    rate = as_float(given.get("controller", {}).get("limits.effort_rate", 0.0))
    controller = {**others, **_rigid_gains(arm, hardware, rate), **given.get("controller", {})}
    simulator = {**settings["simulator"], **given.get("simulator", {})}
    return replace(_made(arm, hardware), settings={**settings, "controller": controller, "simulator": simulator})


@pytest.mark.parametrize("hardware", ["geared", "collaborative"])
@pytest.mark.parametrize(
    "condition",
    [
        {"controller": {"activation.blend": 0.5, "barrier.margin": 0.05, "limits.tracking_error": 0.15}},
        {"controller": {"limits.effort_rate": 500.0}},
        {"controller": {"feedback.effort": "measured"}},
        {"controller": {"rehearsal.restart": 4.0, "activation.blend": 0.1}},
        {"simulator": {"dropout.time": 5.0, "dropout.duration": 0.04, "dropout.probability": 0.1}},
        {"simulator": {"model_error.mass": 0.2, "payload.mass": 1.5, "payload.time": 5.0}},
    ],
    ids=lambda condition: ", ".join(name for node in condition.values() for name in node),
)
def test_limits_feedback_and_model_errors_make_it_no_worse_than_the_rigid_one(
    condition: Settings, hardware: str
) -> None:
    knows = make_experiment(None, robot="panda", hardware=hardware, overrides=condition)
    assert _error(knows) < 1.1 * _error(_rigid("panda", hardware, condition))


def test_torques_measured_behind_the_gears_are_refused() -> None:
    names = {"estimator.name": "elastic_joint_observer", "estimator.at_links": True, "feedback.effort": "measured"}
    with pytest.raises(ParameterError, match="torque sensors behind the gears measure what the springs carry"):
        make_experiment(None, robot="panda", overrides={"controller": names})


@pytest.mark.parametrize(("stiffness", "rotor"), [(0.8, 1.0), (1.2, 1.0), (1.0, 0.85), (1.0, 1.15)])
def test_what_it_knows_of_them_may_be_wrong(stiffness: float, rotor: float) -> None:
    knows = _made("ur5", "geared").values["controller"]
    wrong = {"estimator.stiffness": (stiffness * joint_array(knows["estimator.stiffness"], 6)).tolist()}
    if rotor != 1.0:
        wrong["robot.armature"] = (rotor * joint_array(knows["robot.armature"], 6)).tolist()
    experiment = make_experiment(None, robot="ur5", hardware="geared", overrides={"controller": wrong})
    assert _error(experiment) < 0.8 * _error(_rigid("ur5", "geared"))


def test_where_it_would_have_to_be_slower_the_rigid_one_is_taken() -> None:
    settings = make_experiment(None, hardware="geared").settings
    knows, rigid = (
        hardware_gains(settings["controller"], settings["simulator"], knows_springs=knows) for knows in (True, False)
    )
    assert knows == rigid


@pytest.mark.parametrize("law", ["slotine_li", "pid"])
def test_laws_that_reject_no_disturbance_keep_the_rigid_one(law: str) -> None:
    values = make_experiment(None, law, robot="ur5", hardware="geared").values["controller"]
    assert values["estimator.name"] == "extended_state_observer"


def test_what_adapts_knows_the_springs_but_does_not_take_them_for_late_drives() -> None:
    values = make_experiment(None, robot="ur5", hardware="geared", params="adaptive").values["controller"]
    assert values["estimator.name"] == "elastic_joint_observer"
    assert (values["adaptation.friction"], values["adaptation.softening"]) == ("learn", "act")
    with pytest.raises(ParameterError, match=r"lateness: .* extended_state_observer, not elastic_joint_observer"):
        make_experiment(None, robot="ur5", hardware="geared", overrides=["controller.adaptation.lateness=learn"])


def test_learning_friction_keeps_the_margins_where_the_observer_does_not_know_the_springs() -> None:
    adapts, practical = (
        make_experiment(None, None, 12.0, params, hardware="collaborative") for params in ("adaptive", PRACTICAL)
    )
    slower, usual = (
        np.array(each.values["controller"]["estimator.bandwidth"], np.float64) for each in (adapts, practical)
    )
    assert (slower < usual).all()
    assert np.abs(rollout(adapts).error[5000:]).max() < 1.1 * np.abs(rollout(practical).error[5000:]).max()


def test_stiffer_gears_allow_faster_observers_up_to_those_of_a_rigid_arm() -> None:
    arm = {"robot.description": "panda"}
    simulator = make_experiment(None, robot="panda", hardware="geared").settings["simulator"]
    soft, hard, rigid = (
        (_bandwidth(hardware_gains(arm, {**simulator, "elasticity.stiffness": stiffness}, knows_springs=False)))
        for stiffness in (2e3, 2e4, 0.0)
    )
    assert (soft <= hard).all()
    assert (soft < hard).any()
    assert (hard <= rigid).all()
    assert rigid == pytest.approx(_bandwidth(first_gains(arm, 17, 0.003, 500.0)))


def _bandwidth(gains: tuple[Gain, ...]) -> Array:
    return np.array(next(gain.value for gain in gains if gain.name == "estimator.bandwidth"))
