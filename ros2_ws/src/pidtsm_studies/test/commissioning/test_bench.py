"""When the controller stops the arm, a step tries firmer and softer ones; the next step begins with what worked."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core import robots
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.arm import CommissionError, StoppedError
from pidtsm_studies.commissioning.bench import CAUTION, Bench
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion, rest
from pidtsm_studies.commissioning.room import Room

DEFINITION = ArmDefinition("scara")
HOME = np.zeros(4)
MOTION = rest(HOME, 0.1)


class _Arm:
    """Stops unless the bandwidth of the controller is between two values, relative to that of the rule.

    A heavy one stops any controller that knows of no rotors.
    """

    period = 0.002

    def __init__(
        self, low: float, high: float, error: type[CommissionError] = StoppedError, heavy: bool = False
    ) -> None:
        self.low, self.high, self.error, self.heavy = low, high, error, heavy
        self.tried: list[float] = []
        self.rule = np.ones(4)

    def follow(self, settings: Mapping[str, Any], motion: Motion) -> Samples:
        if self.heavy and not np.any(settings.get("robot.armature", 0.0)):
            self.tried.append(0.0)
            raise self.error("the controller has stopped the arm")
        share = float(np.mean(np.array(settings["estimator.bandwidth"]) / self.rule))
        self.tried.append(round(share, 1))
        if not self.low <= self.tried[-1] <= self.high:
            raise self.error("the controller has stopped the arm")
        states = motion.states.transpose(1, 0, 2)
        return Samples(np.arange(len(states)), states[:, 0], states[:, 0], states, 0)


def bench(arm: _Arm, told: list[str], firmness: float = CAUTION, definition: ArmDefinition = DEFINITION) -> Bench:
    settings = definition.settings()
    room = Room(settings, "")
    result = Bench(settings, settings, None, HOME, arm, {}, told.append, definition.described, room, firmness)
    arm.rule = result.bandwidth()
    return result


@pytest.fixture
def without_rotors(tmp_path: Path) -> ArmDefinition:
    file = tmp_path / "scara.urdf"
    text = Path(robots.__file__).with_name("arms").joinpath("scara.urdf").read_text(encoding="utf-8")
    file.write_text(re.sub(r"<drake:rotor_inertia [^>]*/>", "", text), encoding="utf-8")
    return ArmDefinition(str(file))


@pytest.mark.parametrize(
    ("low", "high", "tried", "words"),
    [
        (0.6, 2.0, [0.7], []),
        (0.9, 2.0, [0.7, 1.0], ["firmer"]),
        (1.2, 2.0, [0.7, 1.0, 1.4], ["firmer", "firmer"]),
        (0.0, 0.6, [0.7, 1.0, 1.4, 0.5], ["firmer", "firmer", "softer"]),
    ],
)
def test_what_follows_is_found_and_kept(low: float, high: float, tried: list[float], words: list[str]) -> None:
    arm, told = _Arm(low, high), list[str]()
    tested = bench(arm, told)
    tested.follow(MOTION)
    assert arm.tried == tried
    assert tested.firmness == tried[-1]
    assert [word for text in told for word in ("firmer", "softer") if f"with a {word} controller" in text] == words
    tested.follow(MOTION)
    assert arm.tried == [*tried, tried[-1]]


def test_each_controller_is_tried_once_and_where_rotors_may_lack_once_more(without_rotors: ArmDefinition) -> None:
    """Relative to the bandwidth of the rule without them."""
    for definition, expected in (
        (DEFINITION, [1.4, 1.0, 0.5, 0.35]),
        (without_rotors, [1.4, 1.0, 0.5, 0.35, 0.35, 1.0, 1.4, 0.5]),
    ):
        arm = _Arm(3.0, 4.0)
        with pytest.raises(StoppedError):
            bench(arm, [], 1.4, definition).follow(MOTION)
        assert arm.tried == pytest.approx(expected, rel=0.2)


def test_rotors_are_assumed_where_nothing_follows_without(without_rotors: ArmDefinition) -> None:
    """Not of a joint whose inertia the first step has seen, nor of one that slides; the result says so."""
    arm, told = _Arm(0.0, 3.0, heavy=True), list[str]()
    tested = bench(arm, told, definition=without_rotors)
    described = np.diag(tested.model().inertia(HOME))
    tested.found = {"signs": {"inertia": [described[0], None, None, None]}}
    tested.follow(MOTION)
    limit = tested.model().effort
    np.testing.assert_allclose(tested.rotors, [0.0, limit[1] / 150.0, 0.0, limit[3] / 150.0])
    assert "rotors assumed" in told[-1]
    count = len(arm.tried)
    tested.follow(MOTION)
    assert len(arm.tried) == count + 1, "the next step begins with them"
    value, reason = tested.rotors_by_reason()["robot.armature"]
    assert value == tested.rotors.tolist()
    assert reason == "rotors assumed, because no controller followed without"


@pytest.mark.parametrize("known", [{"springs": {"rotor": [0.1, 0.1, 0.0, 0.1]}}, {"identify": {"parameters": {}}}])
def test_rotors_that_were_measured_are_not_assumed(known: dict[str, Any], without_rotors: ArmDefinition) -> None:
    arm = _Arm(3.0, 4.0)
    tested = bench(arm, [], definition=without_rotors)
    tested.found = {**known, "springs": {"stiffness": [0.0] * 4, **known.get("springs", {})}}
    with pytest.raises(StoppedError):
        tested.follow(MOTION)
    assert len(arm.tried) == 5
    assert not tested.assumes_rotors


def test_what_no_gains_cure_is_not_tried_again() -> None:
    arm = _Arm(3.0, 4.0, CommissionError)
    with pytest.raises(CommissionError):
        bench(arm, []).follow(MOTION)
    assert arm.tried == [0.7]


def test_joints_that_lack_their_rotors_are_named_with_the_cure() -> None:
    usual = bench(_Arm(0.0, 2.0), [])
    assert usual.too_light() == ""
    strong = {**usual.arm, "limits.effort": (30.0 * usual.model().effort).tolist()}
    text = replace(usual, arm=strong).too_light()
    assert "joint2 by 3.1e+03 rad/s^2, joint4 by" in text
    assert "joint1" not in text
    assert "joint3" not in text
    assert "--set controller.robot.armature=" in text
    shown = {"signs": {"inertia": [None, 0.01, None, 0.001]}}
    assert replace(usual, arm=strong, found=shown).too_light() == "", "the first step has seen that they are so light"
    rotors = {**strong, "robot.armature": 5.0}
    assert replace(usual, arm=rotors).too_light() == ""


def test_a_joint_that_slides_has_less_room_and_none_may_reach_its_limit() -> None:
    """A tracking error of 0.3 m would be more than the whole way of the SCARA's third joint."""
    tested = bench(_Arm(0.0, 2.0), [])
    model = tested.model()
    tested.home = np.array([model.upper[0] - 0.1, 0.0, model.upper[2] - 0.05, 0.0])
    np.testing.assert_allclose(tested.safeguards(1.0)["limits.tracking_error"], [0.3, 0.3, 0.09, 0.3])
    np.testing.assert_allclose(tested.reach(model, 0.5), [0.85 * 0.1, 0.5, 0.85 * 0.05, 0.5])
