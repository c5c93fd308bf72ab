"""What was learnt survives: a new controller goes on from it, and refuses what does not fit."""

import json
import math
from typing import Any

import numpy as np
import pytest
from support.coreloop import CoreLoop

from pidtsm_core.control.findings import What, findings
from pidtsm_core.control.learnt import LearntError, _digest, learnt, recall
from pidtsm_core.control.state import Friction
from pidtsm_core.experiment import ADAPTS
from pidtsm_core.robots import find_robot

LATE = {"encoder.bits": 14, "delay.samples": 45}
RUBS = {"encoder.bits": 14, "delay.samples": 1, "friction.coulomb": [8.0] * 4 + [1.2] * 3}
JOINTS = find_robot({"robot.description": "panda"}).joints


def loop(simulator: dict[str, Any], content: Any = None) -> CoreLoop:
    made = CoreLoop("panda", ADAPTS, simulator)
    if content is not None:
        recall(made.controller.config, made.controller.state, JOINTS, json.loads(content))
    return made


def kept(made: CoreLoop) -> str:
    return json.dumps(learnt(made.controller.config, made.controller.state, JOINTS), allow_nan=False)


@pytest.mark.parametrize(("simulator", "within"), [(LATE, 3e-3), (RUBS, 25e-3)], ids=["late", "friction"])
def test_a_new_controller_begins_with_what_the_last_one_knew(simulator: dict[str, Any], within: float) -> None:
    """The late arm rings, and the one with friction sticks, only in its first life."""
    first = loop(simulator)
    first.advance(10_000)
    second, other = loop(simulator, kept(first)), loop(simulator)
    errors = []
    for each in (second, other):
        each.advance(4_000)
        errors.append(np.abs(each.errors[1_000:]).max())
    assert errors[0] < min(within, 0.7 * errors[1])


def test_what_is_used_grows_slowly_from_zero() -> None:
    first = loop(RUBS)
    first.advance(10_000)
    second = loop(RUBS, kept(first))
    assert not second.controller.state.friction[[Friction.USED, Friction.EFFORT]].any()
    steps = [np.abs(np.diff(each.advance(2_000), axis=0)).max(axis=0) for each in (second, loop(RUBS))]
    assert (steps[0] < 1.05 * steps[1] + 0.5).all()


def test_an_arm_that_has_changed_is_learnt_anew_at_its_first_reversal() -> None:
    """The file promises friction that there is none of any more."""
    first = loop(RUBS)
    first.advance(10_000)
    second = loop({**RUBS, "friction.coulomb": 0.0}, kept(first))
    second.advance(6_500)
    second.advance(1_500)
    assert np.abs(second.errors).max() < 5e-3
    assert np.abs(second.controller.state.friction[Friction.USED]).max() < 0.1


def test_it_states_what_it_knew() -> None:
    first = loop(LATE)
    first.advance(6_000)
    second = loop(LATE, kept(first))
    second.advance(1_000)
    units = find_robot({"robot.description": "panda"}).units
    found = findings(second.controller.config, second.controller.state, JOINTS, units)
    assert [each.value for each in found if each.what is What.LATENESS] == pytest.approx([0.045], rel=0.25)


def changed(digest: bool = True, **parts: Any) -> str:
    """A content with other parts; without a new digest, as if it was edited."""
    content = json.loads(kept(loop(RUBS)))
    content.update(parts)
    content.pop("digest")
    return json.dumps({**content, "digest": _digest(content) if digest else "0"})


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("[]", "not of the form"),
        (changed(form=0), "not of the form"),
        (changed(joints=["a"]), "about the joints"),
        (changed(beyond={"compensation.coulomb": [1.0] * 7}), "learnt with compensation.coulomb"),
        (changed(beyond=[1.0]), "not of the form"),
        (changed(digest=False), "damaged or edited"),
        (kept(loop(RUBS)).replace("0.0", "0.1", 1), "damaged or edited"),
        (changed(friction={}), "friction.normal is missing"),
        (changed(friction=[1.0]), "friction.normal is missing"),
        (changed(lateness={"normal": "late"}), "lateness.normal is missing, or has something else than numbers"),
        (changed(friction={"normal": [0.0]}), r"friction.normal has the shape \(1,\) instead of \(49, 8\)"),
        *((changed(friction={"normal": [[each] * 8] * 49}), "absurd|else than") for each in (math.nan, 1e13, 10**400)),
    ],
)
def test_what_does_not_fit_is_refused_and_changes_nothing(content: str, reason: str) -> None:
    made = loop(RUBS)
    before = kept(made)
    with pytest.raises(LearntError, match=reason):
        recall(made.controller.config, made.controller.state, JOINTS, json.loads(content))
    assert kept(made) == before
