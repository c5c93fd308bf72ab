"""The numbers of docs/errata.md, and an experiment for each reason in claims.yaml."""

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import make_experiment
from pidtsm_core.recording import Recording
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.article.claims import Comparison, compare, printed_rmse
from pidtsm_studies.article.printed import PRINTED

EXACT: Mapping[str, Any] = {"estimator.name": "exact", "law.upsilon": 0.01, "law.anti_windup": "none"}


@cache
def run(
    case: str = "case1", law: str = "piddtsm", rate: int = 1000, duration: float = 30.0, **of_law: float
) -> Recording:
    """A rollout with the article's parameters, and others of the law."""
    gains = {f"law.{name}": value for name, value in of_law.items()}
    simulator = {"rate": rate}
    return rollout(case, law, "article", duration=duration, controller=gains, simulator=simulator)


def rmse(recording: Recording, of: float = 30.0) -> Array:
    """RMSE over 30 s of a run that may be shorter, because what follows is negligible."""
    period = recording.time[1] - recording.time[0]
    return np.asarray(np.sqrt((recording.error**2).sum(axis=0) * period / of))


def early(recording: Recording) -> Array:
    """Share of the sum of squared errors in the first 3 s."""
    squares = recording.error**2
    return np.asarray(squares[recording.time < 3.0].sum(axis=0) / squares.sum(axis=0))


def verdicts(upsilon: float) -> dict[tuple[str, str, tuple[str, ...], int], Comparison]:
    """The comparisons by case, metric, laws and joint with another dead zone."""
    runs = {
        (case, law): (each := run(case, law, upsilon=upsilon), each.metrics())
        for case in ("case1", "case2")
        for law in ("piddtsm", "pidnftsm", "dtsm")
    }
    return {
        (c.claim.case, c.claim.metric, c.claim.laws, c.claim.joint): c for c in compare(runs) if c.holds is not None
    }


def test_the_start_contradicts_52() -> None:
    motion, first = ReferenceMotion(make_experiment("case1").values["trajectory"]), np.zeros((3, 2))
    motion.evaluate(0.0, first)
    assert first[0] == pytest.approx([0.2 + 0.2 * math.cos(0.2), 0.2 * math.cos(0.2) - 0.2])
    assert first[0] == pytest.approx([0.396, -0.004], abs=1e-4)
    assert first[1] == pytest.approx([0.0199, 0.0199], abs=1e-4)
    assert run().position[0] == pytest.approx([0.0, -0.1])


def test_the_disturbance_pushes_the_arm_along() -> None:
    """The terms of (51) in the velocities are its damping, if they brake."""
    dq = run().velocity
    power = dq[:, 0] * (0.5 * dq[:, 0] + 0.5 * np.sin(dq[:, 0])), dq[:, 1] * (1.3 * dq[:, 1] + 1.1 * np.sin(dq[:, 1]))
    assert all((each >= 0.0).all() and each.mean() > 0.0 for each in power)


def test_20_gives_32_and_31_does_not() -> None:
    rng = np.random.default_rng(0)
    gamma, tau_sw, disturbance = rng.normal(size=(3, 2))
    phi = 0.5 * np.linalg.inv([[8.0, 1.5], [1.5, 6.0]])
    torque = -np.linalg.solve(phi, gamma - tau_sw)  # (20), (21)
    assert gamma + phi @ torque + disturbance == pytest.approx(tau_sw + disturbance)  # (18) is (32)
    as_printed = gamma - phi @ (np.linalg.solve(phi, gamma + tau_sw) + disturbance)
    assert as_printed == pytest.approx(-tau_sw - phi @ disturbance)


def test_much_of_the_gain_grows_where_30_as_printed_keeps_it_constant() -> None:
    """Share of eq. (30)'s growth while sigma is negative."""
    sigma = run().manifold_variable
    growth = np.where(np.abs(sigma) > 0.2, np.abs(sigma), 0.0)
    share = (growth * (sigma < 0.0)).sum(axis=0) / growth.sum(axis=0)
    assert share == pytest.approx([0.96, 0.30], abs=0.01)


def test_the_square_root_of_53_is_meant() -> None:
    square = float(np.mean(run().error[:, 0] ** 2))
    assert square == pytest.approx(0.00144, abs=1e-5)
    assert math.sqrt(square) == pytest.approx(printed_rmse("case1")["piddtsm"][0], rel=0.01)


@pytest.mark.parametrize("rate", [1000, 5000, 20_000])
def test_pidnftsms_rmse_comes_from_its_approach(rate: int) -> None:
    recording = run(law="pidnftsm", rate=rate, duration=8.0)
    assert rmse(recording) == pytest.approx([0.0402, 0.0088], abs=5e-5)
    assert early(recording) == pytest.approx([0.981, 0.990], abs=2e-3)
    assert printed_rmse("case1")["pidnftsm"] == pytest.approx([0.0508, 0.0165], abs=1e-4)


def test_nor_do_the_derivatives_matter() -> None:
    exact = rollout("case1", "pidnftsm", duration=8.0, controller=EXACT)
    assert rmse(exact) == pytest.approx([0.0402, 0.0088], abs=5e-5)


def test_the_increment_of_case_2_is_smaller_than_the_articles() -> None:
    ours = rmse(run("case2")) - rmse(run())
    article = np.subtract(printed_rmse("case2")["piddtsm"], printed_rmse("case1")["piddtsm"])
    assert article == pytest.approx([1.9e-4, 1.4e-4])
    assert ours == pytest.approx([5.1e-7, 4.6e-6], rel=0.02)
    assert article / ours == pytest.approx([374, 31], rel=0.03)
    assert (early(run()) > 0.999).all()


def test_four_verdicts_of_case_2_depend_on_the_dead_zone() -> None:
    laws = ("piddtsm", "pidnftsm", "dtsm")
    four = [("case2", metric, laws, joint) for metric in ("recovery_time", "error_after_event") for joint in (0, 1)]
    wide, narrow = verdicts(0.2), verdicts(0.001)
    assert [wide[each].holds for each in four] == [False] * 4
    assert [narrow[each].holds for each in four] == [True] * 4
    lost = {key for key in wide if wide[key].holds and not narrow[key].holds}
    assert lost == {
        ("case1", "steady_state_error", laws, 0),
        ("case1", "torque_variation", laws, 0),
        ("case1", "torque_variation", laws, 1),
        ("case2", "recovery_time", ("dtsm", "pidnftsm", "piddtsm"), 0),
        ("case2", "recovery_time", ("dtsm", "pidnftsm", "piddtsm"), 1),
    }
    assert run(upsilon=0.001).adaptive_gain[-1, 0] == pytest.approx(77, abs=1)


def test_the_steady_torques_differ_more_than_their_medians() -> None:
    ours, theirs = (np.abs(run("case2", law).effort[18_000:]) for law in ("piddtsm", "pidnftsm"))
    below = 1.0 - np.median(theirs, axis=0) / np.median(ours, axis=0)
    assert below == pytest.approx([0.017, 0.013], abs=1e-3)
    between = np.abs(run("case2").effort - run("case2", "pidnftsm").effort)[18_000:]
    assert np.median(between, axis=0) == pytest.approx([2.2, 0.61], rel=0.05)
    assert np.median(between, axis=0) / ours.mean(axis=0) == pytest.approx([0.056, 0.039], abs=3e-3)
    assert between[:, 0].max() == pytest.approx(59, abs=2)


def test_dtsms_kappa_is_a_fit() -> None:
    found = {kappa: rmse(run(law="dtsm", kappa=kappa)) for kappa in (0.05, 0.3, 2.0)}
    article = printed_rmse("case1")["dtsm"]
    assert article == pytest.approx([0.0762, 0.0254], abs=1e-4)
    assert found[0.3] == pytest.approx([0.0751, 0.0167], abs=1e-4)
    assert [found[0.05][0], found[2.0][0]] == pytest.approx([0.058, 0.102], abs=1e-3)
    assert found[2.0][1] < article[1]
    assert run(law="dtsm", kappa=0.01).metrics()["outcome"] == "ran away"


def test_u_f_is_limited_in_no_sample_of_the_articles_cases() -> None:
    for case in ("case1", "case2"):
        e, de = np.abs(run(case).estimated_error), np.abs(run(case).estimated_velocity_error)
        assert e.shape == (30_000, 2)
        assert np.count_nonzero(e ** (7 / 9 - 1.0) * de >= 5.0) == 0


def _start() -> None:
    assert (early(run()) > 0.999).all()
    others = [rollout("case1", controller=each) for each in ({}, EXACT, {**EXACT, "law.anti_windup": "conditional"})]
    values = [rmse(each) for each in (run(), *others)]
    assert 1e-5 < np.ptp([each[0] for each in values]) < 2e-4


def _load() -> None:
    increments = [rmse(run("case2", upsilon=each)) - rmse(run(upsilon=each)) for each in (0.01, 0.2, 1.0)]
    assert (np.diff(increments, axis=0) > 0.0).all()
    assert increments[-1] == pytest.approx([9.3e-6, 1.33e-4], rel=0.02)


def _dead_zone() -> None:
    narrow, wide = (run(upsilon=each).metrics()["steady_state_error"] for each in (0.2, 1.0))
    assert wide[1] > 10.0 * narrow[1]


def _transient() -> None:
    size = np.abs(run().error[:, 0])
    times = [run().time[np.flatnonzero(size >= share * size[0])[-1]] for share in (0.05, 0.02, 0.002)]
    assert times == pytest.approx([0.77, 3.0, 6.1], abs=0.05)


_SPIKY = (("piddtsm", 1000), ("pidnftsm", 1000), ("pidnftsm", 20_000))


def _singularity() -> None:
    ours, coarse, fine = (run(law=law, rate=rate, duration=8.0) for law, rate in _SPIKY)
    per_second = [each.metrics()["torque_variation_rate"][0] for each in (ours, coarse, fine)]
    assert per_second[1] == pytest.approx(per_second[2], rel=0.15)
    assert per_second[1] > 5.0 * per_second[0]


def _approach() -> None:
    assert (early(run(law="pidnftsm", duration=8.0)) > 0.98).all()
    rates = [rmse(run(law="pidnftsm", rate=rate, duration=8.0)) for rate in (1000, 20_000)]
    assert rates[0] == pytest.approx(rates[1], rel=2e-3)


def _kappa() -> None:
    test_dtsms_kappa_is_a_fit()


def _gravity() -> None:
    q = run().position
    second = 1.5 * 0.85 * 9.8 * np.cos(q.sum(axis=1))
    holding = np.column_stack((2.0 * 9.8 * np.cos(q[:, 0]) + second, second))
    assert np.abs(run().effort).mean(axis=0) == pytest.approx(np.abs(holding).mean(axis=0), rel=0.005)


def _ripple() -> None:
    test_the_steady_torques_differ_more_than_their_medians()


def _recovery() -> None:
    times = [run("case2", upsilon=each).metrics()["recovery_time"][0] for each in (0.2, 0.5, 1.0)]
    assert times == pytest.approx([0.416, 0.622, 1.657], abs=0.01)


def _limits() -> None:
    for law in ("piddtsm", "pidnftsm", "dtsm"):
        assert (np.abs(run(law=law).effort).max(axis=0) <= (100.0, 50.0)).all()


def _start_away() -> None:
    assert np.abs(run().error[0]) == pytest.approx([0.396, 0.096], abs=1e-3)
    assert (run().time[np.abs(run().error).argmax(axis=0)] < 6.0).all()


EXPERIMENTS: Mapping[str, Callable[[], None]] = {
    "the_start": _start,
    "the_load": _load,
    "the_dead_zone": _dead_zone,
    "the_transient": _transient,
    "the_singularity": _singularity,
    "the_approach": _approach,
    "kappa": _kappa,
    "gravity": _gravity,
    "the_ripple": _ripple,
    "recovery": _recovery,
    "limits": _limits,
    "the_start_away": _start_away,
}


@pytest.mark.parametrize("reason", PRINTED["reasons"])
def test_a_reason_is_backed_by_an_experiment(reason: str) -> None:
    EXPERIMENTS[reason]()


def test_every_experiment_is_for_a_reason() -> None:
    assert set(EXPERIMENTS) == set(PRINTED["reasons"])
