"""Drives of which nobody told the controller how late they are: it finds out, makes up for it, and harms nobody else.

The judges are the simulated arm, whose drives are known, and a least-squares fit by SciPy.
"""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import lstsq
from support.coreloop import CoreLoop

from pidtsm_core.control import lateness_learning as learning
from pidtsm_core.control.bank import HYPOTHESES, NUISANCES
from pidtsm_core.control.late_drives import Lateness
from pidtsm_core.laws import LAWS
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Mode, Signal, Status

REAL = {"encoder.bits": 14}
LEARNS = {"adaptation.lateness": "learn"}


def late_error(robot: str, controller: dict[str, Any], simulator: dict[str, Any]) -> float:
    """Largest error from 5 s to 8 s, rad."""
    given = {**REAL, **simulator}
    run = rollout(params="practical", robot=robot, duration=8.0, controller=controller, simulator=given)
    return float(np.abs(run.position - run.reference[:, 0])[5000:].max())


@pytest.mark.parametrize(
    ("robot", "delay", "lag"),
    [
        ("panda", 0.045, 0.0),
        ("ur5", 0.054, 0.0),
        ("z1", 0.04, 0.0),
        ("panda", 0.0, 0.065),
        ("xarm7", 0.0, 0.065),
        ("ur5", 0.02, 0.03),
        ("scara", 0.025, 0.03),
    ],
)
def test_unknown_lateness_is_found_and_made_up_for(robot: str, delay: float, lag: float) -> None:
    late = {"delay.samples": round(1e3 * delay), "actuator.lag": lag}
    loop = CoreLoop(robot, LEARNS, {**REAL, **late})
    loop.advance(8000)
    assert np.abs(loop.errors[5000:]).max() < 0.015
    assert loop.controller.late
    found = loop.controller.lateness
    assert abs(found[:2].sum() - delay - lag) < 2.0 * found[2] < 0.03
    assert late_error(robot, {}, late) > 0.012


@pytest.mark.parametrize("robot", ["panda", "ur5", "z1", "xarm7", "scara", "two_link"])
@pytest.mark.parametrize(
    "unlike",
    [
        {},
        {"payload.mass": 0.5, "payload.time": 3.0},
        {"model_error.mass": 0.3},
        {"friction.coulomb": 0.5},
        {"delay.samples": 1, "encoder.bits": 12},
    ],
    ids=str,
)
def test_drives_that_are_not_late_are_left_alone(robot: str, unlike: dict[str, Any]) -> None:
    before = late_error(robot, {"adaptation.friction": "learn"}, unlike)
    after = late_error(robot, {"adaptation.friction": "learn", **LEARNS}, unlike)
    assert after < 1.3 * before + 5e-4


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if law.uses_model and law.name != "impedance"])
def test_the_adaptive_set_of_every_law_bears_late_drives(law: str) -> None:
    late = {**REAL, "delay.samples": 30}
    errors = [
        rollout(None, law, duration=6.0, params=params, robot="panda", simulator=late).error[4000:]
        for params in ("practical", "adaptive")
    ]
    assert np.abs(errors[1]).max() < 0.02
    assert np.abs(errors[1]).max() < 0.5 * np.abs(errors[0]).max()


def test_the_fit_is_that_of_scipy() -> None:
    random, loop = np.random.default_rng(1), CoreLoop("two_link", LEARNS, REAL)
    state, dt, samples = loop.controller.state, 1e-3, 300
    known, left = random.normal(size=(samples, NUISANCES)), random.normal(size=(samples, len(HYPOTHESES)))
    for a, b in zip(known, left, strict=True):
        state.bank.known[0, -1], state.bank.filters[0, -1] = a, b
        learning._weigh(state, 0, dt)
    learning._fit(state, 0)
    weights = np.sqrt(dt * np.exp(-dt / 10.0 * np.arange(samples)[::-1]))[:, np.newaxis]
    a, b = weights * known, weights * left
    squares = ((a @ lstsq(a, b)[0] - b) ** 2).sum(axis=0)
    np.testing.assert_allclose(np.exp(state.bank.left[0]), squares, rtol=1e-6)


def test_to_warn_changes_no_bit() -> None:
    late = {**REAL, "delay.samples": 10}
    efforts = [CoreLoop("panda", {"adaptation.lateness": mode}, late).advance(3000) for mode in ("none", "warn")]
    np.testing.assert_array_equal(efforts[0], efforts[1])


def test_switching_it_makes_no_step_of_the_torque() -> None:
    loop = CoreLoop("ur5", LEARNS, {**REAL, "delay.samples": 15})
    usual = np.abs(np.diff(loop.advance(5_000)[3_000:], axis=0)).max()
    for mode in ("warn", "learn", "none", "learn"):
        before = loop.controller.effort.copy()
        loop.controller.set_parameters({**loop.values, "adaptation.lateness": mode})
        efforts = loop.advance(1000)
        assert np.abs(efforts[0] - before).max() < 2.0 * usual + 1.0
        assert np.abs(loop.errors).max() < 0.05


def test_what_was_learnt_is_not_used_once_it_is_switched_off() -> None:
    loop = CoreLoop("ur5", {**LEARNS, "drive.delay": 0.01}, {**REAL, "delay.samples": 40})
    loop.advance(3000)
    state = loop.controller.state
    assert state.lateness[Lateness.DELAY] > 0.005
    loop.controller.set_parameters({**loop.values, "adaptation.lateness": "none"})
    loop.advance(1)
    assert not state.lateness.any()


def test_what_is_assumed_at_first_ends() -> None:
    loop = CoreLoop("panda", LEARNS, REAL)
    loop.advance(300)
    assert loop.controller.state.lateness[Lateness.DELAY] > 0.005
    loop.advance(2700)
    assert loop.controller.state.lateness[Lateness.DELAY] == 0.0


def test_other_knowledge_begins_anew() -> None:
    loop = CoreLoop("ur5", LEARNS, {**REAL, "delay.samples": 30})
    loop.advance(3000)
    assert loop.controller.late
    loop.controller.set_parameters({**loop.values, "drive.delay": 0.03})
    assert not loop.controller.late
    loop.advance(3000)
    assert not loop.controller.late
    assert np.abs(loop.errors[1500:]).max() < 5e-3


def test_nothing_is_learnt_or_forgotten_while_the_arm_does_not_follow() -> None:
    loop = CoreLoop("panda", LEARNS, {**REAL, "delay.samples": 30})
    loop.advance(2000)
    state = loop.controller.state
    before = state.bank.squares.copy()
    for mode in (Mode.HOLDING, Mode.STOPPED, Mode.FREEDRIVE):
        state.status[Status.MODE] = mode
        state.signals[Signal.VELOCITY] = 0.1
        learning.learn_lateness(loop.controller.config, state, 1e-3)
        assert (state.bank.squares == before).all()
    assert state.lateness[Lateness.LATE] == 1.0
