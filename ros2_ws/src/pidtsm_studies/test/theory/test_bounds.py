"""Bounds along runs: against a disturbance that is known, the article's case, and what the theorem promises."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.theory.bounds import Bounds, evaluate

IDEAL: Mapping[str, Any] = {"estimator.name": "exact", "law.upsilon": 0.01, "law.anti_windup": "none"}


def judged(
    scenario: str = "case1", law: str | None = None, parameters: Mapping[str, Any] | None = None
) -> tuple[Recording, Bounds]:
    experiment = make_experiment(scenario, law, overrides={"controller": parameters or {}})
    recording = rollout(experiment)
    bounds = evaluate(recording, experiment.values["controller"])
    assert bounds is not None
    return recording, bounds


@pytest.fixture(scope="module")
def ideal() -> tuple[Recording, Bounds]:
    """Case 1 with true derivatives, as the equations are written."""
    return judged(parameters=IDEAL)


@pytest.fixture(scope="module")
def loaded() -> tuple[Recording, Bounds]:
    """Case 2, likewise."""
    return judged("case2", parameters=IDEAL)


def inertia(q2: np.ndarray) -> np.ndarray:
    """Eq. (48) with the article's figures, shape (samples, 2, 2)."""
    m1, m2, r1, r2, j1, j2 = 0.5, 1.5, 1.0, 0.85, 5.0, 5.0
    p2, p3 = m2 * r1 * r2, m2 * r2**2
    coupling = p3 + p2 * np.cos(q2)
    p4 = np.full_like(q2, p3 + j2)
    rows = [[(m1 + m2) * r1**2 + p3 + j1 + 2.0 * p2 * np.cos(q2), coupling], [coupling, p4]]
    return np.moveaxis(np.array(rows), -1, 0)


def test_the_disturbance_is_that_of_eqs_17_and_51(ideal: tuple[Recording, Bounds]) -> None:
    """From the article's formulas at the recorded motion, instead of from accelerations."""
    recording, bounds = ideal
    (q1, q2), (dq1, dq2) = recording.position.T, recording.velocity.T
    first = 0.5 * dq1 + np.sin(3.0 * q1) + 0.5 * np.sin(dq1)
    second = 1.3 * dq2 - 1.8 * np.sin(2.0 * q2) + 1.1 * np.sin(dq2)
    lumped = 0.5 * np.linalg.solve(inertia(q2), np.column_stack((first, second))[:, :, np.newaxis])[:, :, 0]
    # Measured, it also has the change of the torque that a period of 1 ms leaves out, which is largest at the start.
    assert bounds.disturbance == pytest.approx(np.abs(lumped).max(axis=0), rel=0.15)
    late = recording.time > 2.0
    need = np.abs(np.gradient(lumped, recording.time, axis=0) + lumped)
    assert np.nanmax(np.abs(bounds.need - need)[late]) < 0.02 < 0.2 * need[late].max()


def test_sigma_is_tau_sw_plus_lambda(ideal: tuple[Recording, Bounds]) -> None:
    """Eq. (32): the disturbance from accelerations is that from sigma, once sigma is small."""
    recording, bounds = ideal
    late = recording.time > 2.0
    from_sigma = np.abs(recording.manifold_variable - recording.switching_term)[late].max(axis=0)
    assert (from_sigma <= bounds.disturbance + 0.005).all()


def test_the_gain_ends_above_what_the_disturbance_needs(ideal: tuple[Recording, Bounds]) -> None:
    _, bounds = ideal
    assert (bounds.gain[-1] > bounds.gain_condition).all()
    assert (bounds.gain_condition > bounds.gain_needed).all()
    assert bounds.gain_condition == pytest.approx(2.0 * bounds.disturbance_rate)  # (1 + k) with k = 1
    assert (bounds.short < 0.01).all()
    assert (bounds.switching_term <= bounds.switching_bound).all()


def test_a_wide_dead_zone_leaves_the_gain_below_it() -> None:
    """With upsilon = 0.2 the gain of joint 1 stops short of (23), (24): sigma stays in its zone without it."""
    _, bounds = judged()
    assert bounds.gain[-1, 0] < bounds.gain_needed[0] < bounds.gain_condition[0]
    assert bounds.short[0] == pytest.approx(0.026, abs=0.01)


def test_v_falls_up_to_the_passage_of_e_through_zero(ideal: tuple[Recording, Bounds]) -> None:
    recording, bounds = ideal
    assert bounds.lyapunov[0] == pytest.approx(7.55, abs=0.05)
    assert bounds.lyapunov[-1] < 2e-3 * bounds.lyapunov[0]
    assert 0.001 < bounds.lyapunov_rise < 0.02
    assert bounds.sigma_integral.sum() < bounds.sigma_bound
    crossing = recording.time[np.flatnonzero(np.diff(np.sign(recording.error[:, 0])))[0]]
    assert bounds.last_outside[0] == pytest.approx(crossing, abs=0.1)


def test_the_load_step_breaks_assumption_1(loaded: tuple[Recording, Bounds]) -> None:
    """Lambda jumps, so its rate has no bound: over a window half as long it is twice as large."""
    recording, bounds = loaded
    assert bounds.event_jump == pytest.approx([0.324, 0.159], abs=0.01)
    jump = bounds.event_jump
    assert (jump / 1e-3 > 100.0 * bounds.disturbance_rate).all()
    assert recording.event_time == 15.0


def test_settling_takes_longer_than_a_finite_time_would_allow(ideal: tuple[Recording, Bounds]) -> None:
    _, bounds = ideal
    assert (bounds.settling > 2.0 * bounds.settling_bound).all()
    assert bounds.printed[1] < 0.0 < bounds.settling_exact[1]
    assert bounds.reaching_time == pytest.approx([0.061, 0.074], abs=0.02)


def test_s_decays_at_the_slow_root_in_the_loop(ideal: tuple[Recording, Bounds]) -> None:
    """Within 2 %: sampled, with the article's disturbance."""
    assert ideal[1].decay == pytest.approx([0.586, 0.586], rel=0.02)


def test_u_f_is_never_limited_in_the_articles_cases(loaded: tuple[Recording, Bounds]) -> None:
    assert (loaded[1].limited == 0.0).all()
    assert (loaded[1].terminal_rate < 2.0).all()


@pytest.mark.parametrize("law", ["pidnftsm", "dtsm", "super_twisting", "sliding_mode"])
def test_other_laws_have_the_bounds_that_they_have(law: str) -> None:
    _, bounds = judged("case1", law)
    assert np.isfinite(bounds.gain_needed).all()
    assert np.isnan(bounds.printed).all() == (law != "dtsm")
    assert np.isfinite(bounds.gain_condition).all() == (law in ("pidnftsm", "dtsm"))
    json = bounds.to_json()
    assert json["joints"] == ["joint1", "joint2"]
    assert (json["limited"] == [None, None]) == (law != "dtsm")


def test_super_twisting_is_judged_by_levants_condition() -> None:
    _, bounds = judged("case1", "super_twisting", {"law.integral_gain": 0.1})
    assert (bounds.short > 0.0).all()
    assert (bounds.gain == 0.1).all()
    _, enough = judged("case1", "super_twisting")
    assert (enough.short == 0.0).all()


def test_laws_without_a_sliding_variable_have_none() -> None:
    experiment = make_experiment("case1", "computed_torque", 0.1)
    assert evaluate(rollout(experiment), experiment.values["controller"]) is None


def test_what_was_only_measured_is_refused() -> None:
    experiment = make_experiment("case1", duration=0.1)
    recording, values = rollout(experiment), experiment.values["controller"]
    with pytest.raises(UsageError, match="need the true motion"):
        evaluate(replace(recording, truth="measured"), values)
    short = make_experiment("case1", duration=0.002)
    with pytest.raises(UsageError, match="at least three samples"):
        evaluate(rollout(short), values)
