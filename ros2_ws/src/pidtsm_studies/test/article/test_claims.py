"""The article's claims compared with artificial runs."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal, Status
from pidtsm_core.written import NOTHING
from pidtsm_studies.article.claims import (
    ARTICLE_LAWS,
    CLAIMS,
    Comparison,
    Reproduction,
    Run,
    as_json,
    claim_of,
    compare,
    markdown,
    printed_rmse,
)
from pidtsm_studies.article.measures import MEASURES, measure
from pidtsm_studies.article.printed import PRINTED
from pidtsm_studies.reports.labels import CASES, LABELS, style_indices


def made_up_run(case: str, law: str, scale: float = 1.0) -> Run:
    """3 s with an error that decays from `scale` times (-0.4, -0.1) rad and a torque of `scale` times (30, 12) N m."""
    time = np.arange(3000) / 1000
    reference = np.zeros((time.size, 3, 2))
    reference[:, 0] = np.column_stack([np.sin(time), np.cos(time)])
    recording = Recording(
        joints=("joint1", "joint2"),
        time=time,
        stamps_ns=np.arange(time.size, dtype=np.int64) * 1_000_000,
        position=reference[:, 0] + scale * np.array([-0.4, -0.1]) * np.exp(-5.0 * time[:, None]),
        velocity=np.zeros((time.size, 2)),
        effort=scale * np.array([30.0, 12.0]) * np.ones((time.size, 2)),
        reference=reference,
        signals=np.ones((time.size, len(Signal), 2)) * np.exp(-time)[:, None, None],
        status=np.zeros((time.size, len(Status)), dtype=np.uint8),
        compute_time=np.empty(0),
        scenario=case,
        law=law,
        clock=None,
        event_time=1.5 if case == "case2" else None,
    )
    return recording, recording.metrics()


SCALES = {"piddtsm": 1.0, "pidnftsm": 1.25, "dtsm": 2.0}


@pytest.fixture(scope="module")
def reproduction() -> Reproduction:
    return {(case, law): made_up_run(case, law, scale) for case in CASES for law, scale in SCALES.items()}


def one(comparisons: list[Comparison], case: str, joint: int, **attributes: Any) -> Comparison:
    (comparison,) = (
        comparison
        for comparison in comparisons
        if (comparison.claim.case, comparison.claim.joint) == (case, joint)
        and all(getattr(comparison.claim, k) == v for k, v in attributes.items())
    )
    return comparison


def test_every_claim_has_a_source_and_a_reason() -> None:
    for claim in CLAIMS:
        assert claim.quantity
        assert "section 4" in claim.printed_in
        assert claim.reason.endswith(".")
        assert claim.case in CASES
        assert set(claim.laws) <= set(ARTICLE_LAWS)


def test_every_reason_is_used_by_a_claim() -> None:
    assert set(PRINTED["reasons"].values()) == {claim.reason for claim in CLAIMS}


def test_the_metric_of_every_claim_is_known_and_has_a_unit_unless_it_is_a_count(reproduction: Reproduction) -> None:
    for claim in CLAIMS:
        run = reproduction[claim.case, claim.laws[0]]
        assert not isinstance(run, str)
        assert claim.metric in {*MEASURES, *run[1]}, claim.quantity
        assert (claim.unit == "") == (claim.metric == "torque_jumps"), claim.quantity


def test_every_claim_is_there_once_for_each_joint() -> None:
    places = [(type(c), c.quantity, c.case, c.laws, c.printed_in) for c in CLAIMS]
    assert len(set(places)) == len(PRINTED["claims"])
    for place in places:
        assert [c.joint for c, other in zip(CLAIMS, places, strict=True) if other == place] == [0, 1]


def test_an_entry_has_what_its_kind_needs_and_no_more() -> None:
    common = {"quantity", "kind", "case", "laws", "metric", "unit", "printed_in", "reason"}
    own = {"number": {"values", "about"}, "decrease": {"values"}, "limit": {"values"}, "order": {"signs"}}
    laws = {"number": 1, "decrease": 2}
    for entry in PRINTED["claims"]:
        kind = entry["kind"]
        known = common | own.get(kind, set())
        assert known - {"unit", "about"} <= entry.keys() <= known, entry
        assert len(entry["laws"]) == laws.get(kind, len(set(entry["laws"])))
        assert len(entry.get("values", (0, 0))) == 2
        assert set(entry.get("signs", (-1, 1))) <= {-1, 1}
        assert len(entry.get("signs", (0, 0))) == 2


def test_an_unknown_kind_is_rejected() -> None:
    entry = {**PRINTED["claims"][0], "kind": "rumour"}
    with pytest.raises(ValueError, match=r"claims\.yaml: RMSE: unknown kind of claim rumour"):
        claim_of(entry, 0)


def test_comparisons_are_plain_data_for_json(reproduction: Reproduction) -> None:
    recording, metrics = made_up_run("case2", "piddtsm")
    never = {**reproduction, ("case2", "piddtsm"): (recording, {**metrics, "recovery_time": [None, None]})}
    for comparison in compare(never):
        content = as_json(comparison)
        assert json.loads(json.dumps(content, allow_nan=False)) == content
        assert [value if value is None or math.isfinite(value) else None for value in comparison.values] == (
            content["values"]
        )
        assert content["why"] == comparison.claim.reason


@pytest.mark.parametrize(
    ("case", "joint", "printed"),
    [("case1", 0, 0.03808), ("case1", 1, 0.00889), ("case2", 0, 0.03827), ("case2", 1, 0.00903)],
)
def test_numbers_have_the_relative_deviation(reproduction: Reproduction, case: str, joint: int, printed: float) -> None:
    comparison = one(compare(reproduction), case, joint, quantity="RMSE", laws=("piddtsm",))
    run = reproduction[case, "piddtsm"]
    assert not isinstance(run, str)
    rmse = run[1]["rmse"][joint]
    assert comparison.claim.printed() == f"{printed} rad"
    assert comparison.values == (rmse,)
    assert comparison.deviation == f"{100 * (rmse / printed - 1):+.1f} %"
    assert comparison.holds is None


@pytest.mark.parametrize(
    ("other", "joint", "printed", "project"),
    [("pidnftsm", 0, 25, 20), ("pidnftsm", 1, 46, 20), ("dtsm", 0, 50, 50), ("dtsm", 1, 65, 50)],
)
def test_percentages_are_below_the_other_law(
    reproduction: Reproduction, other: str, joint: int, printed: int, project: int
) -> None:
    comparison = one(compare(reproduction), "case1", joint, quantity=f"RMSE against {other.upper()}")
    assert comparison.claim.printed() == f"{printed} % lower"
    assert comparison.project == f"{project}.0 % lower"
    assert comparison.deviation == f"{project - printed:+.1f} percentage points"


def test_a_worse_law_is_described_as_higher(reproduction: Reproduction) -> None:
    worse = {**reproduction, ("case1", "pidnftsm"): made_up_run("case1", "pidnftsm", 0.5)}
    comparison = one(compare(worse), "case1", 0, quantity="RMSE against PIDNFTSM")
    assert (comparison.project, comparison.deviation) == ("100.0 % higher", "-125.0 percentage points")


def test_statements_hold_or_not(reproduction: Reproduction) -> None:
    comparisons = compare(reproduction)
    assert one(comparisons, "case1", 0, quantity="RMSE", laws=ARTICLE_LAWS).holds is True
    against_dtsm = {"quantity": "ECI, mean |torque|", "laws": ("piddtsm", "dtsm")}
    assert one(comparisons, "case1", 0, **against_dtsm).holds is True
    assert one(comparisons, "case1", 1, **against_dtsm).holds is False  # the article has it higher in joint 2
    assert one(comparisons, "case2", 0, quantity="ECI, mean |torque|").holds is True
    torque = one(comparisons, "case2", 0, laws=("piddtsm", "pidnftsm"), printed_in="section 4, Case 2, Figure 11")
    assert torque.holds is False  # 30 and 37.5 N m are not nearly the same


def test_limits_are_those_of_the_largest_of_all_laws(reproduction: Reproduction) -> None:
    limit = one(compare(reproduction), "case1", 0, quantity="largest applied torque")
    assert (limit.claim.printed(), limit.project, limit.holds) == ("at most 100 N m", "at most 60 N m", True)
    beyond = {**reproduction, ("case1", "dtsm"): made_up_run("case1", "dtsm", 4.0)}
    assert one(compare(beyond), "case1", 0, quantity="largest applied torque").holds is False


def test_a_time_that_was_not_reached_is_later_than_all_others(reproduction: Reproduction) -> None:
    recording, metrics = made_up_run("case2", "dtsm")
    never = {**reproduction, ("case2", "dtsm"): (recording, {**metrics, "recovery_time": [None, None]})}
    recovery = "recovery from the load step, until |e| stays below 1e-3 rad"
    unsatisfactory = one(compare(never), "case2", 0, quantity=f"{recovery}: DTSM is unsatisfactory")
    assert unsatisfactory.values[0] == math.inf
    assert unsatisfactory.holds is True
    assert "DTSM not within the run" in unsatisfactory.project
    never = {**reproduction, ("case2", "piddtsm"): (recording, {**metrics, "recovery_time": [None, None]})}
    own = one(compare(never), "case2", 0, quantity=recovery, laws=("piddtsm",))
    assert (own.project, own.deviation) == ("not within the run", NOTHING)


def test_without_runs_every_comparison_is_marked_so() -> None:
    for comparison in compare({("case1", "dtsm"): "not finite after 0.5 s"}):
        assert "not run" in comparison.project or comparison.project == "DTSM: not finite after 0.5 s"
        assert comparison.deviation == NOTHING
        assert comparison.holds is None
        assert None in comparison.values


def test_a_run_without_the_event_has_no_recovery(reproduction: Reproduction) -> None:
    run = made_up_run("case1", "piddtsm")
    own = [
        each
        for each in compare({("case2", "piddtsm"): run})
        if (each.claim.case, each.claim.laws) == ("case2", ("piddtsm",)) and "recovery" in each.claim.quantity
    ]
    assert [(each.values, each.project) for each in own] == [((None,), NOTHING)] * 2


def test_the_table_has_one_line_per_comparison(reproduction: Reproduction) -> None:
    comparisons = compare(reproduction)
    head, rule, *lines = markdown(comparisons).splitlines()
    assert len(lines) == len(comparisons)
    for line in (head, rule, *lines):
        assert line.replace(r"\|", "").count("|") == 9  # 8 columns, whatever bars the texts have
    for line, comparison in zip(lines, comparisons, strict=True):
        assert comparison.project.replace("|", r"\|") in line
        assert comparison.claim.reason.replace("|", r"\|") in line


def test_the_articles_rmse_of_other_laws_follows_from_its_percentages() -> None:
    assert printed_rmse("case1") == {
        "piddtsm": [0.03808, 0.00889],
        "pidnftsm": [0.03808 / 0.75, 0.00889 / 0.54],
        "dtsm": [0.03808 / 0.5, pytest.approx(0.00889 / 0.35)],
    }
    assert printed_rmse("case2") == {"piddtsm": [0.03827, 0.00903]}


def test_a_law_has_the_same_style_regardless_of_the_other_laws() -> None:
    alone = style_indices(["dtsm"])
    assert alone["dtsm"] == style_indices([*LABELS])["dtsm"]
    mixed = style_indices(["mine", "piddtsm", "another"])
    assert list(mixed) == ["piddtsm", "another", "mine"]
    assert len(set(mixed.values())) == 3


def test_overshoot_is_on_the_other_side_of_the_start() -> None:
    recording, _ = made_up_run("case1", "piddtsm")
    assert measure("overshoot")(recording, {}, 0) == 0.0
    beyond = recording.position.copy()
    beyond[2000, 0] += 0.05
    error = beyond[2000, 0] - recording.reference[2000, 0, 0]
    assert measure("overshoot")(replace(recording, position=beyond), {}, 0) == pytest.approx(error)
