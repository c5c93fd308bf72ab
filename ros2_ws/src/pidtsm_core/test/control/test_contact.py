"""The controller recognises contact, learns nothing from it, and takes nothing else for contact."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters import resolve
from pidtsm_core.recording import Recording
from pidtsm_core.robots.source import ARMS, rated_payload
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Signal, Status, Violation

PUSH = {"push.force": [0.0, 60.0, 0.0], "push.time": 2.0, "push.duration": 1.0}
"""Pushes the tool of the Panda."""
OFF: dict[str, Any] = {"limits.external_effort": 0.0}


def touched(run: Recording) -> Any:
    """Whether the controller took the arm to be in contact at each sample."""
    return run.status[:, Status.VIOLATIONS] & Violation.EXTERNAL_EFFORT != 0


def pushed(params: tuple[str, ...] = (), controller: dict[str, Any] | None = None) -> Recording:
    return rollout(None, "piddtsm", params, "panda", duration=4.0, controller=controller or {}, simulator=PUSH)


def limits_of(arm: str) -> Array:
    """Effort limits of an arm, N m or N, shape (joints,)."""
    return np.array(make_experiment(None, "piddtsm", 1.0, "practical", robot=arm).values["simulator"]["limits.effort"])


def test_the_limit_is_a_quarter_of_the_effort_limits() -> None:
    panda = {"robot.description": "panda"}
    assert resolve(controller_schema, panda, 7)["limits.external_effort"] == (21.75,) * 4 + (3.0,) * 3
    assert resolve(controller_schema, {**panda, "limits.effort": 8.0}, 7)["limits.external_effort"] == (2.0,) * 7
    assert resolve(controller_schema, {}, 2)["limits.external_effort"] == (25.0, 12.5)


@pytest.mark.parametrize("params", [(), ("practical",)], ids=["defaults", "practical"])
def test_while_something_pushes_nothing_is_learnt(params: tuple[str, ...]) -> None:
    run = pushed(params)
    found = touched(run)
    assert found[run.time > 2.0].any()
    assert not found[run.time < 2.0].any()
    gain = run.adaptive_gain
    # The violation of a sample pauses the adaptation until the next one.
    assert (np.diff(gain, axis=0)[found[:-1]] <= 0.0).all()
    careless = pushed(params, OFF)
    assert not touched(careless).any()
    assert gain.max() < careless.adaptive_gain.max()
    assert np.abs(run.error[-1]).max() < 0.02


def test_without_anti_windup_contact_changes_nothing() -> None:
    runs = [pushed((), {"law.anti_windup": "none", **limit}) for limit in ({}, OFF)]
    assert touched(runs[0]).any()
    np.testing.assert_array_equal(runs[0].signals, runs[1].signals)


def test_a_collision_stops_the_arm_if_it_shall() -> None:
    run = pushed((), {"limits.external_effort_action": "stop"})
    assert run.status[-1, Status.FAULT] == Fault.EXTERNAL_EFFORT_LIMIT
    first = run.time[np.flatnonzero(run.status[:, Status.FAULT])[0]]
    assert 2.0 < first < 2.3
    assert np.abs(run.velocity[-1]).max() < 0.1


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(
    "difference",
    [{"encoder.bits": 14, "delay.samples": 1}, {"model_error.mass": 0.6, "model_error.inertia": 0.6}, {}],
    ids=["sensors", "model", "payload"],
)
def test_neither_noise_nor_a_payload_nor_the_model_is_taken_for_contact(arm: str, difference: dict[str, Any]) -> None:
    load = {} if difference else {"payload.mass": 0.4 * rated_payload(arm), "payload.time": 1.0}
    run = rollout(None, "piddtsm", "practical", arm, duration=3.0, simulator={**difference, **load})
    assert not touched(run).any()
    assert np.abs(run.signals[-1, Signal.POSITION_ERROR]).max() < 3e-3


@pytest.mark.parametrize("arm", ARMS)
def test_friction_that_changes_its_sign_at_a_reversal_is_no_contact(arm: str) -> None:
    """Also where it exceeds half of the limit, and the arm does not track until then."""
    friction = {"friction.coulomb": (0.2 * limits_of(arm)).tolist(), "encoder.bits": 14, "delay.samples": 1}
    run = rollout(None, "piddtsm", "practical", arm, duration=12.0, simulator=friction)
    assert (np.abs(run.error) > 0.01).any()
    assert (np.diff(np.sign(np.diff(run.reference, axis=0)), axis=0) != 0).any(axis=0).all(), "every joint reverses"
    assert not touched(run).any()


def test_contact_is_recognised_in_spite_of_friction() -> None:
    friction = {"friction.coulomb": (0.15 * limits_of("panda")).tolist()}
    late = {**PUSH, "push.force": [0.0, 90.0, 0.0], "push.time": 7.0}
    run = rollout(None, "piddtsm", "practical", "panda", duration=9.0, simulator={**friction, **late})
    found = touched(run)
    assert not found[run.time < 7.0].any()
    assert found[run.time > 7.0].any()
