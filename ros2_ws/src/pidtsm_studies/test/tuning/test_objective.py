"""The objective is that of the rollouts, relative to the rule-based set."""

from dataclasses import replace

import numpy as np
import pytest

from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.score.criteria import CRITERIA
from pidtsm_studies.score.tasks import Task
from pidtsm_studies.tuning.definitions import HARDWARE, MARGINS, conditions
from pidtsm_studies.tuning.objective import Problem, evaluate, make_problem, total
from pidtsm_studies.tuning.space import Space


def test_the_rule_based_set_costs_one_and_a_little(problem: Problem, space: Space) -> None:
    (results,) = evaluate(problem, [space.controller(space.start)])
    assert len(results) == len(problem.conditions) == 6
    for each in results:
        assert each.success
        assert each.rmse == pytest.approx(1.0, rel=0.01)
        assert 1.0 < each.cost < 1.5
    assert total(results) == pytest.approx(np.mean([each.cost for each in results]))


def test_a_result_is_that_of_the_rollout(problem: Problem, space: Space, task: Task) -> None:
    controller = {**space.controller(space.start), "law.k1": [5.0, 5.0]}
    (results,) = evaluate(problem, [controller])
    for result, simulator in zip(results, problem.conditions.values(), strict=True):
        run = rollout(task.experiment(None), controller=controller, simulator=simulator)
        found = run.metrics()
        assert result.metrics["rmse"] == found["rmse"]
        assert result.metrics["torque_variation"] == found["torque_variation"]


def test_failure_and_divergence_cost_more_than_any_success(problem: Problem, space: Space) -> None:
    start = space.controller(space.start)
    weak = {**start, "law.k1": [0.03, 0.03], "law.kp": [0.02, 0.02], "law.k2": [0.005, 0.005]}
    wild = {**start, "estimator.bandwidth": [400.0, 400.0], "law.kd": [1e-9, 1e-9], "limits.effort": [1e9, 1e9]}
    good, failed, diverged = (total(each) for each in evaluate(problem, [start, weak, wild]))
    assert good < 2.0
    assert 6.0 < failed < diverged


@pytest.mark.parametrize("hardware", HARDWARE)
def test_validation_differs_from_training(hardware: str, task: Task, problem: Problem) -> None:
    seen, unseen = (conditions(kind, hardware, task, problem.limits) for kind in ("training", "validation"))
    assert seen
    assert unseen
    assert not [each for each in unseen.values() if each in seen.values()]
    assert all(HARDWARE[hardware].items() <= each.items() for each in unseen.values())


def test_effort_beyond_that_of_the_rule_costs(problem: Problem, space: Space, task: Task) -> None:
    cheaper = {name: np.array([rmse, 0.9 * eci]) for name, (rmse, eci) in problem.reference.items()}
    start = [space.controller(space.start)]
    before, after = (total(evaluate(each, start)[0]) for each in (problem, replace(problem, reference=cheaper)))
    assert after - before == pytest.approx(20.0 * (1.0 / 0.9 - 1.003), abs=0.1)
    assert make_problem(task, "training", "14bit", "smooth").weights != problem.weights


def test_robust_gains_endure_what_the_rule_based_set_endures_and_try_more(problem: Problem, task: Task) -> None:
    robust = make_problem(replace(task, duration=6.0, after=3.0, error=0.02), "training", "14bit", "robust")
    assert {*robust.conditions} == {*problem.conditions, *robust.endured, *robust.beyond}
    labels = {name.partition(", seed")[0] for name in robust.endured}
    assert labels == {each.label for each in CRITERIA if each.name in MARGINS["criteria"]}
    assert {f"{name}, one step more" for name in robust.endured} >= {*robust.beyond} != set()
    rule = task.experiment(None, ("practical",)).settings["controller"]
    kept, lost = (
        evaluate(replace(robust, conditions={name: robust.conditions[name] for name in names}), [rule])[0]
        for names in (robust.endured, robust.beyond)
    )
    assert all(each.success and each.cost == 1.0 for each in kept)
    assert all(not each.success and 1.1 <= each.cost <= 2.0 for each in lost)
