"""Friction that nobody told the controller: it is found, compensated as far as it is certain, and harms nobody else.

The judges are the simulated arm, whose friction is known, and a least-squares fit by SciPy.
"""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import lstsq
from scipy.signal import lfilter
from support.coreloop import CoreLoop

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.control import friction_learning as learning
from pidtsm_core.control.state import Friction
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.recording import Recording
from pidtsm_core.robots.source import ARMS, rated_payload
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Mode, Signal, Status

REAL = {"encoder.bits": 14, "delay.samples": 1}
LEARNS = {"adaptation.friction": "learn"}
LIMITS = {"panda": [87.0] * 4 + [12.0] * 3, "two_link": [100.0, 50.0]}


def run(controller: dict[str, Any], robot: str = "panda", **simulator: Any) -> Recording:
    return rollout(
        params="practical", robot=robot, duration=20.0, controller=controller, simulator={**REAL, **simulator}
    )


def late_error(run: Recording) -> float:
    """Largest error of the second half, rad."""
    errors: Array = np.abs(run.position - run.reference[:, 0])
    return float(errors[errors.shape[0] // 2 :].max())


@pytest.mark.parametrize(("share", "left"), [(0.05, 0.25), (0.1, 0.45), (0.2, 0.35)])
def test_unknown_friction_disturbs_less_and_never_more(share: float, left: float) -> None:
    friction = (share * np.array(LIMITS["panda"])).tolist()
    errors = {
        mode: late_error(run({"adaptation.friction": mode}, **{"friction.coulomb": friction}))
        for mode in ("none", "warn", "learn")
    }
    assert errors["learn"] < left * errors["none"]
    assert errors["warn"] == errors["none"]


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if law.uses_model and law.name != "impedance"])
def test_the_adaptive_set_of_every_law_disturbs_less(law: str) -> None:
    friction = {**REAL, "friction.coulomb": [4.0] * 4 + [0.6] * 3}
    errors = [
        late_error(rollout(None, law, duration=12.0, params=params, robot="panda", simulator=friction))
        for params in ("practical", "adaptive")
    ]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("seed", range(len(ARMS)))
def test_arms_that_are_unlike_their_model_in_several_ways_track_better_and_none_worse(seed: int) -> None:
    random, robot = np.random.default_rng(seed), ARMS[seed % len(ARMS)]
    values = make_experiment(None, None, 1.0, "practical", robot=robot, purpose=MEASUREMENT).values["simulator"]
    limits = np.array(values["limits.effort"])
    hidden = {
        "friction.coulomb": (random.uniform(0.0, 0.2, limits.size) * limits).tolist(),
        "friction.viscous": (random.uniform(0.0, 0.03) * limits).tolist(),
        "delay.samples": int(random.integers(1, 13)),
        "actuator.lag": float(random.uniform(0.0, 0.012)),
        "model_error.mass": float(random.uniform(-0.15, 0.15)),
        "payload.mass": float(random.uniform(0.0, 0.4) * rated_payload(robot)),
        "payload.time": float(random.uniform(0.0, 9.0)),
    }
    before, after = (late_error(run(each, robot, **hidden)) for each in ({}, LEARNS))
    assert after < 0.8 * before


@pytest.mark.parametrize("hardware", [None, "collaborative"])
def test_the_found_friction_is_that_of_the_arm(hardware: str | None) -> None:
    """The observers: one that takes the arm for rigid, and one that knows its springs."""
    true = 0.05 * np.array(LIMITS["panda"])
    simulator = {**REAL, "friction.coulomb": true.tolist(), "friction.static": 0.0}
    controller = {**LEARNS, "compensation.coulomb": 0.0}
    overrides = {"controller": controller, "simulator": simulator}
    experiment = make_experiment(None, None, 20.0, "practical", overrides, "panda", hardware)
    loop = CoreLoop("panda", *(dict(experiment.settings[node]) for node in ("controller", "simulator")))
    loop.advance(20_000)
    coulomb, deviation, _ = loop.controller.friction
    np.testing.assert_allclose(coulomb, true, rtol=0.15)
    assert (np.abs(coulomb - true) < 3.0 * deviation).all()


@pytest.mark.parametrize(
    "imperfection", [{}, {"payload.mass": 1.0, "payload.time": 3.0}, {"model_error.mass": 0.3}], ids=str
)
def test_an_arm_without_friction_is_controlled_as_before(imperfection: dict[str, Any]) -> None:
    before, after = run({}, **imperfection), run(LEARNS, **imperfection)
    assert late_error(after) < 1.1 * late_error(before)
    rough = [np.abs(np.diff(each.effort, axis=0)).mean() for each in (before, after)]
    assert rough[1] < 1.05 * rough[0]


@pytest.mark.parametrize("promised", [0.0, 3.0])
def test_the_fit_is_that_of_scipy(promised: float) -> None:
    random, loop = np.random.default_rng(1), CoreLoop("two_link", LEARNS, {})
    state, dt, samples, of = loop.controller.state, 1e-3, 300, learning.Regressor
    inputs = random.normal(size=(samples, len(of) + 1))
    kept = np.exp(-dt / 4.0 * np.arange(samples)[::-1])  # What is left in the end of the evidence of each sample.
    prior = np.sqrt(learning._PRIOR)

    def fitted(count: int) -> tuple[Array, Array]:
        """By SciPy, after so many samples: the coefficients, and the matrix that they solve."""
        weight = np.sqrt(dt * kept[-count:])[:, np.newaxis]
        matrix = np.vstack([weight * inputs[:count, :-1], np.diag(prior)])
        right = np.concatenate([weight[:, 0] * inputs[:count, -1], [prior[0] * promised], np.zeros(len(of) - 1)])
        return lstsq(matrix, right)[0], matrix

    left = np.empty(samples)
    for k, each in enumerate(inputs):
        left[k] = each[-1] - each[:-1] @ (fitted(k)[0] if k else np.zeros(len(of)))
        state.friction_inputs[-1, : each.size] = each
        learning._weigh(state, 0, dt)
        learning._fit(state, 0, promised)
    solution, matrix = fitted(samples)
    found = state.friction[[Friction.COULOMB, Friction.SOFT, Friction.VISCOUS], 0]
    coulomb = solution[[of.HARD, of.MIDDLE, of.SOFT]].sum()
    np.testing.assert_allclose(found, [coulomb, solution[of.SOFT], solution[of.VELOCITY]], rtol=1e-9)
    gone = -np.expm1(-dt / 0.4)
    slow = lfilter([gone], [1.0, gone - 1.0], left)
    variance = 3.0 * 0.4 * (kept @ slow**2) / kept.sum() * np.linalg.inv(matrix.T @ matrix)[:3, :3].sum()
    np.testing.assert_allclose(state.friction[Friction.DEVIATION, 0], np.sqrt(variance), rtol=1e-6)


def test_what_the_fit_cannot_explain_counts_for_less() -> None:
    state, j = CoreLoop("two_link", LEARNS, {}).controller.state, 1
    assert learning._weight(state, j, 100.0) == 1.0  # Nothing is known yet.
    state.friction_fit[j, learning.Regressor.HARD], state.friction_fit[j, -1] = 2.0, 0.1
    state.friction_inputs[-1, len(learning.Regressor) + 1 + learning.Regressor.HARD] = 1.0
    left = [learning._left(state, j, lacking) for lacking in (2.0, 2.29, 2.6, 1.4)]
    assert left == pytest.approx([0.0, 0.29, 0.6, -0.6])
    assert [learning._weight(state, j, each) for each in left] == pytest.approx([1, 1, 0.5, 0.5])


@pytest.mark.parametrize("robot", ["xarm7", "z1"])
def test_noise_is_not_taken_for_less_friction(robot: str) -> None:
    """A noisy velocity makes friction look smaller than it is; where it is noisy, the desired one takes its place."""
    errors = [late_error(run(each, robot, **{"noise.std": 1.6e-3})) for each in ({}, LEARNS)]
    assert errors[1] < 1.5 * errors[0]


@pytest.mark.parametrize("robot", ["z1", "xarm7"])
def test_friction_that_is_as_described_is_left_alone_from_the_start(robot: str) -> None:
    """Before the first reversal nothing tells what the description promises."""
    run = rollout(params="practical", robot=robot, duration=6.0, simulator=REAL, controller=LEARNS)
    assert np.abs(run.error[500:]).max() < 3e-3


def test_switching_it_makes_no_step_of_the_torque() -> None:
    friction = [8.0, 4.0]
    loop = CoreLoop("two_link", LEARNS, {**REAL, "friction.coulomb": friction})
    usual = np.abs(np.diff(loop.advance(6_000)[3_000:], axis=0)).max()
    assert np.abs(loop.controller.state.friction[Friction.EFFORT]).max() > 1.0
    for mode in ("none", "learn"):
        before = loop.controller.effort.copy()
        loop.controller.set_parameters({**loop.values, "adaptation.friction": mode})
        assert np.abs(loop.advance(1)[0] - before).max() < 2.0 * usual
        loop.advance(500)


def test_what_is_added_to_the_parameters_is_not_compensated_twice() -> None:
    loop = CoreLoop("two_link", LEARNS, {**REAL, "friction.coulomb": [8.0, 4.0]})
    loop.advance(6_000)
    found, before = loop.controller.friction[0], loop.controller.effort.copy()
    assert (found > 2.0).all()
    loop.controller.set_parameters({**loop.values, "compensation.coulomb": found.tolist()})
    assert np.abs(loop.advance(1)[0] - before).max() < 0.5
    loop.advance(6_000)
    assert np.abs(loop.controller.friction[0]).max() < 0.25 * found.min()


def test_another_effort_limit_changes_nothing_that_was_found() -> None:
    loop = CoreLoop("two_link", LEARNS, {**REAL, "friction.coulomb": [8.0, 4.0]})
    loop.advance(6_000)
    found = loop.controller.state.friction.copy()
    loop.controller.set_parameters({**loop.values, "limits.effort": [200.0, 100.0]})
    loop.advance(1)
    np.testing.assert_allclose(loop.controller.state.friction[Friction.EFFORT], found[Friction.EFFORT], rtol=0.02)


def test_nothing_is_learnt_or_forgotten_while_the_arm_is_held_back_or_holds() -> None:
    loop = CoreLoop("two_link", LEARNS, {**REAL, "friction.coulomb": [8.0, 4.0]})
    loop.advance(5_000)
    state = loop.controller.state
    for mode, saturated in ((Mode.FOLLOWING, 1.0), (Mode.HOLDING, 0.0), (Mode.STOPPED, 0.0)):
        before = state.friction_evidence.copy()
        state.status[Status.MODE] = mode
        state.signals[Signal.VELOCITY] = 0.1
        state.signals[Signal.SATURATED] = saturated
        learning.learn_friction(loop.controller.config, state, 1e-3)
        assert (state.friction_evidence == before).all()


def test_gears_that_are_colder_than_the_rule_believes_are_found() -> None:
    """Springs, sticking motors and encoders behind them: what 15 % more friction than compensated costs."""
    friction = np.asarray(
        make_experiment(None, robot="xarm7", hardware="geared").values["simulator"]["friction.coulomb"]
    )
    believed = {"controller": {"compensation.coulomb": (1.15 * friction).tolist(), "compensation.error_gain": 0.0}}
    errors = [
        late_error(rollout(make_experiment(None, None, 40.0, params, believed, "xarm7", "geared")))
        for params in ("practical", "adaptive")
    ]
    assert errors[1] < 0.9 * errors[0]


def test_an_estimator_that_finds_no_disturbance_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"adaptation\.friction: estimator\.name must be .*, not filtered"):
        resolve(controller_schema, LEARNS, 2)
