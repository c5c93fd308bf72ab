"""Arms whose torque is rough follow in a slower time; the others keep their bits."""

import math
from typing import Any

import numpy as np
import pytest
from support.coreloop import CoreLoop

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.control.state import Softness
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout

SOFTENING = "adaptation.softening"
ACT, WARN = {SOFTENING: "act"}, {SOFTENING: "warn"}
NOISE = {"noise.std": 4e-3}
QUIET: dict[str, dict[str, Any]] = {
    "14 bits, 1 ms": {"encoder.bits": 14, "delay.samples": 1},
    "payload": {"encoder.bits": 14, "payload.mass": 2.0, "payload.time": 1.0},
    "push": {
        "encoder.bits": 14,
        "push.effort": [0.0, 60.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "push.time": 1.0,
        "push.duration": 0.3,
    },
    "friction": {"encoder.bits": 14, "friction.coulomb": 9.0},
    "samples lost": {"encoder.bits": 14, "dropout.probability": 0.3},
}
SOFTENS = [law.name for law in LAWS.members if law.softens]


def run(simulator: dict[str, Any], controller: dict[str, Any], robot: str = "panda", seconds: float = 6.0) -> Recording:
    return rollout(params="practical", robot=robot, duration=seconds, controller=controller, simulator=simulator)


def roughness(run: Recording, limits: Array) -> float:
    """Mean change of the command of a joint from sample to sample in the second half of a run, share of its limit."""
    commands = run.commanded_effort[run.time.size // 2 :]
    return float((np.abs(np.diff(commands, axis=0)).mean(axis=0) / limits).max())


@pytest.mark.parametrize("robot", ["panda", "ur5", "xarm7", "z1"])
def test_a_noisy_arm_is_quiet_and_still_follows(robot: str) -> None:
    limits = CoreLoop(robot, {}, {}).controller.config.limits.effort
    rough, soft = (run(NOISE, each, robot) for each in ({}, ACT))
    assert roughness(rough, limits) > 0.012
    assert roughness(soft, limits) < 0.0075
    assert np.abs(soft.error[soft.time > 3.0]).max() < 1e-2


@pytest.mark.parametrize("law", SOFTENS)
def test_every_law_with_a_model_is_quiet(law: str) -> None:
    limits = CoreLoop("panda", {}, {}).controller.config.limits.effort
    make: dict[str, Any] = {"params": "practical", "robot": "panda", "law": law, "duration": 6.0, "simulator": NOISE}
    soft = rollout(**make, controller=ACT)
    assert roughness(soft, limits) < 0.6 * roughness(rollout(**make), limits)
    assert np.abs(soft.error[soft.time > 3.0]).max() < 1e-2


@pytest.mark.parametrize("what", QUIET)
def test_where_nothing_is_rough_no_bit_changes(what: str) -> None:
    without, soft, warned = (run(QUIET[what], each) for each in ({}, ACT, WARN))
    assert np.array_equal(without.signals, soft.signals)
    assert np.array_equal(without.signals, warned.signals)


def test_an_arm_that_is_rough_for_another_reason_does_not_go_limp() -> None:
    """The lag that was learnt, and is inverted, amplifies the steps of the encoders; and all joints feel it."""
    drives = {"encoder.bits": 14, "actuator.lag": 0.0156, "payload.mass": 1.1, "payload.time": 3.0}
    run = rollout(params="adaptive", robot="xarm7", duration=10.0, simulator=drives)
    assert np.abs(run.error).max() < 2e-2


@pytest.mark.parametrize("robot", ["panda", "ur5", "z1"])
def test_an_arm_that_strays_is_stiffened_again(robot: str) -> None:
    """Noise, and friction that slower gains would leave uncorrected: it matters more to follow than to be quiet."""
    limits = CoreLoop(robot, {}, {}).controller.config.limits.effort
    hidden = {**NOISE, "encoder.bits": 14, "friction.coulomb": (0.08 * limits).tolist()}
    stiff, soft = (run(hidden, each, robot, seconds=12.0) for each in ({}, ACT))
    errors = [np.abs(each.error[each.time > 8.0]).max() for each in (stiff, soft)]
    assert errors[1] < 1.5 * errors[0]


def test_a_warning_changes_nothing_and_tells_how_rough_it_is() -> None:
    without, warned = (run(NOISE, each, seconds=2.0) for each in ({}, WARN))
    assert np.array_equal(without.signals, warned.signals)
    loop = CoreLoop("panda", WARN, NOISE)
    commands = loop.advance(2000)[1000:]
    change = np.abs(np.diff(commands, axis=0)).mean(axis=0) / loop.controller.config.limits.effort
    found = loop.controller.state.softness[Softness.ROUGHNESS]
    assert np.all(found < np.minimum(change, 0.02))  # What a sample counts for is bounded.
    assert np.all(found > 0.6 * np.minimum(change, 0.02))
    assert loop.controller.pace == 1.0


@pytest.mark.parametrize("law", SOFTENS)
def test_a_softened_arm_does_the_same_in_a_slower_time(law: str) -> None:
    """A push of half as much in the time and a quarter of the acceleration moves the arm as far, twice as slowly."""

    def moved(softened: float) -> Array:
        given = {**ACT, "law.name": law, "adaptation.roughness": 0.09}
        push = {
            "push.time": 2.0,
            "push.effort": [0.0, 0.0, 0.0, 20.0 * softened**2, 0.0, 0.0, 0.0],
            "push.duration": 0.02 / softened,
        }
        loop = CoreLoop("panda", given, push)
        loop.controller.state.softened[0], loop.controller.state.spared[0] = -math.log(softened), 0.0
        errors = []
        for _ in range(round(2000 + 400 / softened)):
            loop.advance(1)
            loop.controller.state.softened[0], loop.controller.state.spared[0] = -math.log(softened), 0.0
            errors.append(loop.errors[0, 3])
        return np.array(errors[2000 :: round(1.0 / softened)])

    quick, slow = moved(1.0), moved(0.5)
    assert slow == pytest.approx(quick, abs=0.15 * np.abs(quick).max())


def test_the_pace_does_not_oscillate() -> None:
    loop, paces = CoreLoop("panda", ACT, NOISE), []
    for _ in range(100):
        loop.advance(100)
        paces.append(loop.controller.pace)
    assert paces[-1] < 0.9
    assert np.all(np.diff(paces[30:]) <= 0.0)  # In another posture, a joint may be rougher.
    assert paces[30] - paces[-1] < 0.15


def test_the_pace_returns_once_it_is_quiet() -> None:
    loop = CoreLoop("panda", ACT, {})
    loop.controller.state.softened[0] = math.log(4.0)
    for _ in range(13):
        loop.advance(1000)
        assert loop.controller.pace < 1.0
    loop.advance(2000)
    assert loop.controller.pace == 1.0


def test_switching_it_off_and_on_makes_no_step() -> None:
    loop = CoreLoop("panda", ACT, NOISE)
    loop.advance(3000)
    usual = np.abs(np.diff(CoreLoop("panda", {}, NOISE).advance(3000)[2000:], axis=0)).max(axis=0)
    for given in ("none", "act"):
        values = {**loop.values, SOFTENING: given}
        before = loop.controller.effort.copy()
        loop.controller.set_parameters(resolve(controller_schema, values, loop.controller.joints))
        after = loop.advance(1)[0]
        assert np.all(np.abs(after - before) < usual)
        loop.advance(500)


def test_it_needs_the_observer() -> None:
    with pytest.raises(
        ParameterError, match=r"adaptation\.softening: estimator\.name must be .*extended_state_observer"
    ):
        resolve(controller_schema, {**ACT, "estimator.name": "filtered_difference"}, 2)
