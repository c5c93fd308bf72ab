"""The second edition of the score: around a class of hardware, with the oracle as its ceiling and a control row."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.experiment.hardware_classes import hardware_content
from pidtsm_core.robots import NAMES
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.written import THIN, number
from pidtsm_studies.score.criteria import CRITERIA_ON_HARDWARE, FULL_ON_HARDWARE, LEVELS, ROUGHNESS, Extent
from pidtsm_studies.score.groups import behind_the_best, by_arm, ceiling
from pidtsm_studies.score.leaderboard import document, write_leaderboard
from pidtsm_studies.score.measure import ORACLE, measure
from pidtsm_studies.score.motions import motions
from pidtsm_studies.score.page import write_score_page
from pidtsm_studies.score.plan import CONTROL, Contender, bad_gains, make_plan
from pidtsm_studies.score.results import Entry, as_json, read_entry
from pidtsm_studies.score.tasks import ON_HARDWARE, Task, effort_limits, find_task
from pidtsm_studies.score.variations import changes, scaled
from pidtsm_studies.score.wording import title

FEW = Extent(values=2, repeats=2)
LIMITS = np.array([100.0, 50.0])


@pytest.fixture(scope="module")
def task() -> Task:
    """That of the two-link arm, which is cheap, on geared hardware."""
    return find_task("two_link", "geared", ON_HARDWARE)


@pytest.fixture(scope="module")
def entries(task: Task) -> list[Entry]:
    oracle = Contender(None, name=ORACLE, oracle=True)
    return [measure(task, each, FEW) for each in (Contender(None), oracle, bad_gains(task), Contender("pid"))]


def test_the_oracle_is_above_every_controller_in_every_criterion(entries: list[Entry]) -> None:
    law, oracle, bad, pid = entries
    for mine, other, best in zip(law.outcomes, pid.outcomes, oracle.outcomes, strict=True):
        assert max(mine.share, other.share) <= best.interval[1], mine.criterion.name
    assert oracle.score > 0.8 > law.score > 0.1 > bad.score


def test_a_run_counts_by_the_levels_that_its_rollout_meets(entries: list[Entry], task: Task) -> None:
    plan = make_plan(task, Contender(None), FEW)
    curves = {(o.criterion.name, c.range.label): c for o in entries[0].outcomes for c in o.curves}
    for key in (("delay", "delay of the measurements"), ("speed", CRITERIA_ON_HARDWARE[-2].ranges[0].label)):
        runs = [rollout(run.experiment) for run in plan.varied if run.key == key]
        met = []
        for run in runs:
            late = run.time >= task.after
            rough = np.abs(np.diff(run.commanded_effort[late], axis=0)).mean(axis=0) / LIMITS
            error = np.abs(run.error[late]).max()
            met.append(0 if (rough > ROUGHNESS).any() else sum(error < level for level in LEVELS))
        assert [each for value in curves[key].met for each in value] == met


def test_a_table_has_shares_of_what_is_possible_and_paired_intervals(entries: list[Entry], tmp_path: Path) -> None:
    (rows,) = by_arm(entries).values()
    assert rows[0].name == ORACLE
    assert rows[-1].name == CONTROL
    assert ceiling(rows) is rows[0]
    behind = behind_the_best(rows[2], rows)
    assert behind is not None
    assert behind.mean == pytest.approx(rows[1].score - rows[2].score)
    assert behind.low <= behind.mean <= behind.high
    assert 0.0 < behind.p <= 1.0
    write_leaderboard(tmp_path, entries)
    text = document(entries)
    assert "## two_link-geared" in text
    assert f"| {100.0 * rows[1].score / rows[0].score:.0f} % |" in text
    page = (tmp_path / "leaderboard.html").read_text()
    assert "of what is possible" in page
    assert f"{title(rows[1])} leads on 1 of 1 arm" in page, "the oracle does not compete"
    assert "Motion of the nominal run" in page


def test_the_page_of_one_controller_is_about_it(entries: list[Entry], tmp_path: Path) -> None:
    write_score_page(tmp_path / "report.html", "Score", entries[:2])
    law, oracle = entries[:2]
    score, possible = (f"{number(100.0 * share)}{THIN}%" for share in (law.score, law.score / oracle.score))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"succeeds in {score} of the runs, {possible} of what is possible" in page


def test_a_file_keeps_everything(entries: list[Entry], tmp_path: Path) -> None:
    file = tmp_path / "score.json"
    file.write_text(json.dumps(as_json(entries[0]), allow_nan=False))
    read = read_entry(file)
    assert replace(read, controller={}) == replace(entries[0], controller={})
    assert json.dumps(as_json(read)) == json.dumps(as_json(entries[0]))


def test_tuned_sets_stand_apart(entries: list[Entry]) -> None:
    tuned = replace(entries[0], params=("tuned_14bit",))
    tables = by_arm([*entries, tuned])
    assert [*tables] == ["two_link-geared", "two_link-geared-tuned"]
    assert [each.name for each in tables["two_link-geared-tuned"]] == [ORACLE, tuned.name, CONTROL]


@pytest.mark.parametrize("robot", NAMES)
def test_every_arm_has_a_class_and_motions_within_its_limits(robot: str) -> None:
    task = find_task(robot, None, ON_HARDWARE)
    hardware_content(str(task.hardware))
    experiment = task.experiment(None)
    known = motions(experiment)
    assert [each.name for each in known] == ["sines", "pick_and_place", "reversals", "fast"]
    for motion in known:
        assert motion.of(experiment).values
        assert motion.fastest > 0.0
    slow = known[2].trajectory
    peak = 2.0 * np.pi * slow["reference.frequency"] * np.array(slow["reference.amplitude"])
    assert np.degrees(peak).max() == pytest.approx(3.0)


def test_every_range_changes_the_class_within_what_the_simulator_accepts(task: Task) -> None:
    experiment = task.experiment(None)
    simulator = experiment.values["simulator"]
    limits = effort_limits(simulator)
    assert len({c.name for c in CRITERIA_ON_HARDWARE}) == len(CRITERIA_ON_HARDWARE) == 14
    for each in (each for criterion in CRITERIA_ON_HARDWARE for each in criterion.ranges):
        values = each.values(FULL_ON_HARDWARE)
        assert len(set(values)) == 21
        found = [changes(each, value, 0, task, limits, simulator) for value in (values[0], values[-1])]
        assert each.relative_to == "fastest" or found[0] != found[1]
    twice, none = scaled(simulator, 2.0), scaled(simulator, 0.0)
    assert np.array(twice["elasticity.stiffness"]) == pytest.approx(np.array(simulator["elasticity.stiffness"]) / 2.0)
    assert twice["encoder.bits"] == 16
    assert not any(np.any(value) for value in none.values())
