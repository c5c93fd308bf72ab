"""A session goes on where it was interrupted, with the same result, and refuses what is not its own."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.room import TooNearError
from pidtsm_studies.commissioning.session import NAMES, STEPS, RefusedError, Session, Step, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm

DEFINITION = ArmDefinition("scara")
ARM = DEFINITION.settings()
SUBJECT = Subject(
    ARM, make_experiment(None, params="practical", robot=DEFINITION).settings["controller"], None, DEFINITION.described
)
SIMULATED = SimulatedArm({**ARM, "rate": 500, "encoder.bits": 16, "friction.coulomb": 0.5})


class _Asked:
    """Agrees to some steps, and is interrupted or refuses at one."""

    def __init__(self, last: str, error: type[BaseException] | None) -> None:
        self.last, self.error = last, error

    def __call__(self, step: str, plan: Plan) -> bool:
        assert plan.travel.shape == plan.effort.shape == (4,)
        if step == self.last and self.error is not None:
            raise self.error
        return step != self.last


def run(folder: Path, last: str, error: type[BaseException] | None = None) -> Session:
    session = Session.opened(folder, SUBJECT)
    with pytest.raises(error or RefusedError):
        session.run(SIMULATED, _Asked(last, error), lambda _: None, lambda _: None)
    return session


def test_an_interrupted_session_goes_on_with_the_same_result(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", "gravity")
    assert whole.missing == NAMES[NAMES.index("gravity") :]
    for last in ("rest", "friction", "gravity"):
        parts = run(tmp_path / "parts", last, KeyboardInterrupt)
    assert parts.found == whole.found
    again = Session.opened(tmp_path / "whole", SUBJECT)
    again.repeat_from("friction")
    assert "friction" in again.missing
    assert again.previous["friction"] == whole.found["friction"]


def test_a_joint_that_sticks_too_much_is_named_with_the_cure(tmp_path: Path) -> None:
    """Coarse encoders and late drives leave a controller that does not follow it."""
    sticky = {"friction.static": [0.5, 19.5, 0.5, 0.5], "friction.bristle_stiffness": 2e4}
    late = {"friction.stribeck_velocity": 0.02, "encoder.bits": 12, "delay.samples": 3}
    arm = replace(SIMULATED, settings={**SIMULATED.settings, **sticky, **late})
    session = Session.opened(tmp_path, SUBJECT)
    with pytest.raises(CommissionError, match=r"joint2 took \d\d % of its torque limit .* again with --from signs"):
        session.run(arm, lambda *_: True, lambda _: None, lambda _: None)
    assert session.missing[0] == "friction"


@pytest.mark.parametrize("static", [0.5, 7.0])
def test_a_joint_that_sticks_is_named_and_no_other(tmp_path: Path, static: float) -> None:
    sticky = {"friction.static": [0.5, static, 0.5, 0.5], "friction.bristle_stiffness": 2e4}
    arm = replace(SIMULATED, settings={**SIMULATED.settings, **sticky, "friction.stribeck_velocity": 0.02})
    session = Session.opened(tmp_path, SUBJECT)
    with pytest.raises(RefusedError):
        session.run(arm, lambda step, _: step != "gravity", lambda _: None, lambda _: None)
    named = [text for text in session.found["friction"]["problems"] if "expect it to stick" in text]
    assert [text.split()[0] for text in named] == ["joint2"] * (static > 1.0)


def test_an_arm_that_friction_holds_is_followed_by_a_firmer_controller_from_then_on(tmp_path: Path) -> None:
    arm = replace(SIMULATED, settings={**SIMULATED.settings, "friction.coulomb": 8.0})
    session, told = Session.opened(tmp_path, SUBJECT), list[str]()
    with pytest.raises(RefusedError):
        session.run(arm, lambda step, _: step != "identify", told.append, lambda _: None)
    firmness = [session.found[step]["figures"]["firmness"] for step in ("lateness", "friction", "gravity")]
    assert firmness[0] < firmness[1] <= firmness[2]
    assert any("once more with a firmer controller" in text for text in told)


def test_no_controller_moves_an_arm_whose_rotors_are_not_known(tmp_path: Path) -> None:
    strong = {**ARM, "limits.effort": (30.0 * ArmModel(ARM).effort).tolist()}
    session = Session.opened(tmp_path, replace(SUBJECT, arm=strong))
    nothing = dict.fromkeys(("breakaway", "inertia"), [None] * 4)
    session.found["signs"] = {
        "figures": {"position": [1.0] * 4, "effort": [1.0] * 4, "home": [0.0] * 4, **nothing},
        "problems": [],
    }
    with pytest.raises(CommissionError, match=r"no controller moves this arm: .* joint2 .*robot\.armature"):
        session.run(SIMULATED, lambda *_: pytest.fail("no step begins"), lambda _: None, lambda _: None)


@pytest.mark.parametrize(
    ("content", "reason"),
    [({"note.txt": "mine"}, "is not of a commissioning"), ({"session.json": "{}"}, "is damaged")],
)
def test_a_folder_of_something_else_is_refused(tmp_path: Path, content: dict[str, str], reason: str) -> None:
    for name, text in content.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=reason):
        Session.opened(tmp_path, SUBJECT)


def test_a_session_of_another_arm_is_refused(tmp_path: Path) -> None:
    Session.opened(tmp_path, SUBJECT)
    other: dict[str, Any] = {**SUBJECT.before, "law.kd": 0.9}
    with pytest.raises(UsageError, match="another arm, or of other parameters"):
        Session.opened(tmp_path, replace(SUBJECT, before=other))


def test_an_arm_in_closed_form_is_commissioned(tmp_path: Path) -> None:
    """It has no description among its parameters."""
    definition = ArmDefinition("two_link")
    arm = definition.settings()
    before = make_experiment(None, params="practical", robot=definition).settings["controller"]
    session = Session.opened(tmp_path, Subject(arm, before, None, definition.described))
    plant = SimulatedArm({**arm, "rate": 500, "encoder.bits": 16})
    with pytest.raises(RefusedError):
        session.run(plant, lambda step, _: step != "lateness", lambda _: None, lambda _: None)
    assert session.missing == NAMES[2:]
    assert not session.found["rest"]["problems"]


@pytest.mark.parametrize(
    ("tries", "reason"), [(3, None), (9, "A and B are near: begin at another posture, with --from signs")]
)
def test_motions_that_would_touch_something_are_made_smaller(
    tries: int, reason: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Postures that were judged one by one need not show what a motion touches."""
    reaches: list[float] = []

    def rest_of(bench: Bench) -> Outcome:
        reaches.append(float(bench.reach(bench.model(), 0.1)[0]))
        if len(reaches) < tries:
            raise TooNearError("A and B are near")
        return Outcome("", {})

    monkeypatch.setitem(cast(dict[str, Step], STEPS), "rest", replace(STEPS["rest"], run=rest_of))
    session = Session.opened(tmp_path, SUBJECT)
    with pytest.raises(CommissionError if reason else RefusedError, match=reason):
        session.run(SIMULATED, _Asked("lateness", None), lambda _: None, lambda _: None)
    assert reaches[:3] == pytest.approx([0.1, 0.08, 0.064])
