"""The tuned sets keep what is documented about them, under conditions that they were not tuned under."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pidtsm_core
from pidtsm_core.robots import NAMES
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.limit.known import known_limit
from pidtsm_studies.score.tasks import find_task
from pidtsm_studies.tuning.definitions import HARDWARE
from pidtsm_studies.tuning.objective import Result, evaluate, make_problem, total

TUNED = Path(pidtsm_core.__file__).parent / "experiment" / "params" / "tuned"
AFTER = 2.0
"""s from picking up a payload until the error must be small."""


@pytest.mark.parametrize("robot", NAMES)
@pytest.mark.parametrize("hardware", HARDWARE)
def test_every_arm_has_a_set_for_each_class_and_the_command_that_made_it(robot: str, hardware: str) -> None:
    command, _, unseen = (TUNED / f"{robot}-{hardware}.yaml").read_text().splitlines()[:3]
    assert command.startswith(f"# ./pidtsm tune --robot {robot} --law piddtsm --hardware {hardware} --objective ")
    assert "--seed " in command
    before, after = map(float, re.findall(r"[\d.]+(?= before| after)", unseen))
    assert after < before


@pytest.mark.parametrize("robot", NAMES)
def test_it_beats_the_rule_under_unseen_conditions(robot: str) -> None:
    task = find_task(robot)
    problem = make_problem(task, "validation", "14bit", "balanced")
    sets = [task.experiment(None, (name,)).settings["controller"] for name in ("practical", "tuned_14bit")]
    rule, tuned = evaluate(problem, sets)
    assert total(tuned) < total(rule)
    assert sum(each.success for each in tuned) >= sum(each.success for each in rule)
    assert _rmse(tuned) < _rmse(rule) == pytest.approx(1.0)


def _rmse(results: list[Result]) -> float:
    """Mean of the RMSE relative to that of the rule."""
    return float(np.mean([each.rmse for each in results]))


@pytest.mark.parametrize("robot", NAMES)
def test_two_seconds_after_an_unknown_payload_the_error_is_small(robot: str) -> None:
    task = find_task(robot)
    nominal = task.experiment(None, ("tuned_14bit",))
    load = {"payload.mass": 0.4 * task.payload, "payload.time": task.event}
    simulator = {**nominal.settings["simulator"], **HARDWARE["14bit"], **load}
    run = rollout(replace(nominal, settings={**nominal.settings, "simulator": simulator}))
    assert np.abs(run.error[run.time >= task.event + AFTER]).max() < 2e-3


@pytest.mark.parametrize(("hardware", "above", "effort"), [("ideal", 0.03, 1.005), ("14bit", 0.05, 1.006)])
def test_the_two_link_arm_comes_near_the_limit(hardware: str, above: float, effort: float) -> None:
    task = find_task("two_link")
    rule, tuned = (task.experiment(None, (name,)) for name in ("practical", f"tuned_{hardware}"))
    simulator = {**tuned.settings["simulator"], **HARDWARE[hardware]}
    before, after = (
        rollout(replace(e, settings={**e.settings, "simulator": simulator})).metrics() for e in (rule, tuned)
    )
    assert (np.array(after["rmse"]) < (1.0 + above) * np.array(known_limit("two_link"))).all()
    assert (np.array(after["eci"]) < effort * np.array(before["eci"])).all()
