"""A score is the share of its rollouts that succeed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_studies.score.criteria import CRITERIA, HARDWARE, QUICK, ROUGHNESS
from pidtsm_studies.score.measure import measure
from pidtsm_studies.score.plan import Contender
from pidtsm_studies.score.results import Curve, Entry, Outcome, as_json, read_entry
from pidtsm_studies.score.tasks import Task

LIMITS = np.array([100.0, 50.0])


def test_a_curve_counts_the_rollouts_that_succeed(entry: Entry, task: Task, contender: Contender) -> None:
    names = [each.name for each in CRITERIA]
    for name in ("encoder", "noise", "payload"):
        (curve,) = entry.outcomes[names.index(name)].curves
        expected = [succeeds(task, contender, curve, value) for value in curve.values]
        assert list(curve.successes) == expected
        failed = [value for value, success in zip(curve.values, expected, strict=True) if not success]
        assert (curve.failure and curve.failure.value) == (failed[0] if failed else None)
    assert entry.runs == 38


def test_the_first_failure_names_the_joint_that_is_furthest_beyond_its_bound(
    entry: Entry, task: Task, contender: Contender
) -> None:
    nominal = task.experiment(None, contender.params, contender.overrides)
    found = [(c, c.failure) for each in entry.outcomes if not each.criterion.random for c in each.curves if c.failure]
    assert found
    for curve, failure in found:
        run = rollout(nominal, simulator=curve.range.settings(failure.value, 0, task, LIMITS))
        late = run.time >= task.after
        error = np.abs(run.error[late]).max(axis=0) / task.error
        rough = np.abs(np.diff(run.commanded_effort[late], axis=0)).mean(axis=0) / LIMITS / ROUGHNESS
        worst = error if failure.reason == "error" else rough
        assert worst[run.joints.index(failure.joint)] == max(error.max(), rough.max()) > 1.0


def succeeds(task: Task, contender: Contender, curve: Curve, value: float) -> bool:
    nominal = task.experiment(None, contender.params, contender.overrides)
    run = rollout(nominal, simulator=curve.range.settings(value, 0, task, LIMITS))
    late = run.time >= task.after
    rough = np.abs(np.diff(run.signals[late, Signal.EFFORT], axis=0)).mean(axis=0) / LIMITS
    return bool((np.abs(run.error[late]) < task.error).all() and (rough <= ROUGHNESS).all())


def test_nominal_numbers_are_those_of_the_rollout(entry: Entry, task: Task, contender: Contender) -> None:
    nominal = task.experiment(None, contender.params, contender.overrides)
    for name, simulator in (("ideal", {}), ("hardware", HARDWARE)):
        found = rollout(nominal, simulator=simulator).metrics()
        assert entry.nominal[name] == {key: found[key] for key in ("rmse", "eci", "torque_variation")}
    assert entry.succeeds == {"ideal": True, "hardware": True}


def test_the_same_score_has_the_same_bits(entry: Entry, task: Task, contender: Contender) -> None:
    seen: list[tuple[int, int]] = []
    again = measure(task, contender, QUICK, lambda done, total: seen.append((done, total)))
    assert json.dumps(as_json(again)) == json.dumps(as_json(entry))
    assert seen[-1] == (38, 38)


def test_a_file_keeps_everything(entry: Entry, tmp_path: Path) -> None:
    file = tmp_path / "score.json"
    file.write_text(json.dumps(as_json(entry), allow_nan=False))
    assert read_entry(file) == entry


def test_a_file_of_other_criteria_is_refused(entry: Entry, tmp_path: Path) -> None:
    content = as_json(entry)
    del content["criteria"]["friction"]
    file = tmp_path / "score.json"
    file.write_text(json.dumps(content))
    with pytest.raises(UsageError, match=r"score\.json is no score of these criteria \(KeyError\('friction'\)\)"):
        read_entry(file)


def test_a_controller_that_always_diverges_scores_nothing(task: Task) -> None:
    wild = Contender("computed_torque", (), ("controller.law.kp=1e12", "controller.law.kd=0.0"))
    lost = measure(replace(task, duration=2.0, event=0.3, after=1.5), wild, QUICK)
    assert lost.score == 0.0
    assert lost.interval[0] == 0.0 < lost.interval[1]
    assert lost.worst.criterion is CRITERIA[0]


def test_the_interval_covers_what_is_random_only(entry: Entry) -> None:
    low, high = entry.interval
    assert low < entry.score < high
    fixed = tuple(Outcome(replace(each.criterion, random=False), each.curves) for each in entry.outcomes)
    alone = replace(entry, outcomes=fixed)
    assert alone.interval == (alone.score, alone.score)
    # Wilson 1927, for 45 of 100.
    (curve,) = entry.outcomes[1].curves
    hundred = Outcome(CRITERIA[1], (replace(curve, values=(0.0,), successes=(45,), runs=100),))
    assert hundred.interval == pytest.approx((0.3561, 0.5476), abs=1e-4)
