"""The limit is what optimal control reaches, and it is not beaten."""

import sys

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots import forward_dynamics, make_model
from pidtsm_core.robots.two_link import TWO_LINK
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.simulation.disturbances.article import ARTICLE
from pidtsm_studies.limit.optimal import acceleration, find_limit


def test_without_casadi_it_shows_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(UsageError, match=r"limit needs CasADi: .* -r requirements/limit\.lock"):
        find_limit(make_experiment("case1"))


def test_it_is_that_of_an_independent_program_and_the_torque_reaches_it() -> None:
    pytest.importorskip("casadi", reason="CasADi is optional (requirements/limit.lock)")
    experiment = make_experiment("case1")
    limit = find_limit(experiment)
    np.testing.assert_allclose(limit.rmse, [0.03254, 0.00613], rtol=0.015)
    assert (np.abs(limit.effort) <= np.array([100.0, 50.0]) * (1.0 + 1e-6)).all()
    # No law of the project beats it.
    for law in ("piddtsm", "computed_torque"):
        assert (np.array(rollout(experiment, law).metrics()["rmse"]) > limit.rmse).all()


@pytest.mark.parametrize("coriolis", ["paper", "lagrange"])
def test_its_arm_is_that_of_the_rollouts(coriolis: str) -> None:
    casadi = pytest.importorskip("casadi", reason="CasADi is optional (requirements/limit.lock)")
    overrides = [f"{node}.robot.coriolis={coriolis}" for node in ("simulator", "controller")]
    values = make_experiment("case1", overrides=overrides).values["simulator"]
    model = make_model(TWO_LINK, TWO_LINK.pack_model(values))
    for q, dq, effort in np.random.default_rng(1).normal(0.0, 1.0, (5, 3, 2)):
        found = acceleration(casadi, values, casadi.DM(q), casadi.DM(dq), casadi.DM(effort))
        total, expected = effort.copy(), np.zeros(2)
        ARTICLE.add(0.0, q, dq, np.zeros((2, 0)), total)
        forward_dynamics(model, q, dq, total, expected)
        np.testing.assert_allclose(np.asarray(found)[:, 0], expected, rtol=1e-12)


def test_another_arm_is_refused() -> None:
    pytest.importorskip("casadi", reason="CasADi is optional (requirements/limit.lock)")
    with pytest.raises(UsageError, match="the two-link arm without a payload only"):
        find_limit(make_experiment("case2"))
