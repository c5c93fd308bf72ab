"""Each fault is named in a recording that has it, and nothing in one without faults."""

from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots import find_description
from pidtsm_studies.blind.arms import blind_arm
from pidtsm_studies.blind.observe import observe
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.diagnose import diagnose
from pidtsm_studies.diagnosis.report import sentence, write_diagnosis_report

_OF_MODEL = {Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM, Cause.WRONG_GRAVITY, Cause.UNKNOWN_PAYLOAD}
_IDEAL = {Cause.SATURATION, Cause.WRONG_SIGN}
"""With gears, these stop the arm at once, or hide behind friction."""


@pytest.mark.parametrize("cause", [None, *Cause], ids=lambda cause: cause.value if cause else "good")
def test_a_fault_is_named_and_nothing_else(cause: Cause | None, tmp_path: Path) -> None:
    hardware = "" if cause in _IDEAL else "collaborative"
    made = blind_arm(3, tmp_path, "xarm7", [cause] if cause else [], hardware, 12.0)
    experiment = made.experiment
    if cause is None or cause in _OF_MODEL:  # Equations that we did not write; they know no gears.
        rigid = {"elasticity.stiffness": 0.0, "friction.bristle_stiffness": 0.0}
        experiment = make_experiment(experiment, overrides={"simulator": {"engine": "mujoco", **rigid}})
    arm = find_description(made.arm.settings())
    diagnosis = diagnose(observe(experiment), arm)
    found = {each.cause: each for each in diagnosis.found}
    assert set(found) == {each.cause for each in made.truth}, sentence(diagnosis)
    assert diagnosis.is_good == (cause is None)
    for each in made.truth:
        assert not each.joints or set(each.joints) & set(found[each.cause].joints[:2])
        assert found[each.cause].cure.isascii()  # Commands that can be pasted.
        assert found[each.cause].cure
        assert found[each.cause].plots
    page = tmp_path / "page.html"
    write_diagnosis_report(page, diagnosis, "a blind arm", [])
    assert sentence(diagnosis) in page.read_text(encoding="utf-8")


def test_without_an_arm_the_model_is_not_judged_and_the_verdict_says_so(tmp_path: Path) -> None:
    made = blind_arm(3, tmp_path, "scara", [Cause.UNKNOWN_PAYLOAD], "", 12.0)
    diagnosis = diagnose(observe(made.experiment))
    unknown = {each.cause for each in diagnosis.verdicts if each.state.value == "unknown"}
    assert unknown == _OF_MODEL
    assert "5 causes could not be judged" in sentence(diagnosis)


def test_a_recording_of_another_arm_or_of_a_moment_is_refused_with_the_reason(tmp_path: Path) -> None:
    seen = observe(blind_arm(3, tmp_path, "scara", [], "", 2.0).experiment)
    with pytest.raises(UsageError, match="shorter than 3 s"):
        diagnose(seen)
    with pytest.raises(UsageError, match="lack panda_joint1"):
        diagnose(seen, find_description({"robot.description": "panda"}))


@pytest.mark.parametrize("cause", [Cause.WRONG_SIGN, Cause.WRONG_ORDER])
def test_a_loop_that_stops_at_once_tells_why(cause: Cause, tmp_path: Path) -> None:
    made = blind_arm(4, tmp_path, "ur5", [cause], "collaborative", 6.0)
    rigid = {"elasticity.stiffness": 0.0, "friction.bristle_stiffness": 0.0}
    overrides = {"simulator": {"engine": "mujoco", **rigid}}
    observed = observe(make_experiment(made.experiment, overrides=overrides))
    assert observed.stopped
    assert observed.following is not None
    assert np.count_nonzero(observed.following) * observed.period < 1.0
    diagnosis = diagnose(observed, find_description(made.arm.settings()))
    assert [(each.cause, set(each.joints)) for each in diagnosis.found] == [(cause, set(made.truth[0].joints))]
    assert "before it stopped" in sentence(diagnosis) or diagnosis.stopped in sentence(diagnosis)


def test_a_loop_that_a_limit_stops_at_once_has_no_fault_but_is_not_good(tmp_path: Path) -> None:
    made = blind_arm(3, tmp_path, "ur5", [], "", 6.0)
    slow = make_experiment(made.experiment, overrides={"controller": {"limits.velocity": [0.1] * 6}})
    observed = observe(slow)
    diagnosis = diagnose(observed, find_description(made.arm.settings()))
    assert observed.stopped == "velocity limit"
    assert diagnosis.found == ()
    assert not diagnosis.is_good
    unknown = {each.cause for each in diagnosis.verdicts if each.state.value == "unknown"}
    assert unknown >= {Cause.RINGING, Cause.STICK_SLIP, Cause.SATURATION, Cause.OTHER_ARM}
