"""The article's numbers beside made-up runs."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal, Status
from pidtsm_core.summary import summarize
from pidtsm_studies.article.claims import (
    ARTICLE_LAWS,
    CLAIMS,
    Comparison,
    Reproduction,
    Run,
    compare,
    markdown,
    printed_rmse,
)
from pidtsm_studies.article.measures import measure
from pidtsm_studies.reports.labels import CASES, LABELS, NOTHING, style_indices


def made_up_run(case: str, law: str, scale: float = 1.0) -> Run:
    """3 s with an error that falls from `scale` times (-0.4, -0.1) rad and a torque of `scale` times (30, 12) N m."""
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
    return recording, summarize(recording)


SCALES = {"piddtsm": 1.0, "pidnftsm": 1.25, "dtsm": 2.0}


@pytest.fixture(scope="module")
def reproduction() -> Reproduction:
    return {(case, law): made_up_run(case, law, scale) for case in CASES for law, scale in SCALES.items()}


def one(rows: list[Comparison], case: str, joint: int, **attributes: Any) -> Comparison:
    (row,) = (
        row
        for row in rows
        if (row.claim.case, row.claim.joint) == (case, joint)
        and all(getattr(row.claim, k) == v for k, v in attributes.items())
    )
    return row


def test_every_claim_has_a_source_and_a_reason() -> None:
    for claim in CLAIMS:
        assert claim.quantity
        assert "section 4" in claim.printed_in
        assert claim.reason.endswith(".")
        assert claim.case in CASES
        assert set(claim.laws) <= set(ARTICLE_LAWS)


def test_claims_are_there_once() -> None:
    rows = compare({})
    assert (
        len(
            {(row.claim.quantity, row.claim.case, row.claim.laws, row.claim.joint, row.claim.printed()) for row in rows}
        )
        == len(rows)
        == len(CLAIMS)
    )


@pytest.mark.parametrize(
    ("case", "joint", "printed"),
    [("case1", 0, 0.03808), ("case1", 1, 0.00889), ("case2", 0, 0.03827), ("case2", 1, 0.00903)],
)
def test_numbers_have_the_relative_deviation(reproduction: Reproduction, case: str, joint: int, printed: float) -> None:
    row = one(compare(reproduction), case, joint, quantity="RMSE", laws=("piddtsm",))
    rmse = reproduction[case, "piddtsm"][1]["rmse"][joint]  # type: ignore[index, call-overload]
    assert row.claim.printed() == f"{printed} rad"
    assert row.values == (rmse,)
    assert row.deviation == f"{100 * (rmse / printed - 1):+.1f} %"
    assert row.holds is None


@pytest.mark.parametrize(
    ("other", "joint", "printed", "project"),
    [("pidnftsm", 0, 25, 20), ("pidnftsm", 1, 46, 20), ("dtsm", 0, 50, 50), ("dtsm", 1, 65, 50)],
)
def test_percentages_are_below_the_other_law(
    reproduction: Reproduction, other: str, joint: int, printed: int, project: int
) -> None:
    row = one(compare(reproduction), "case1", joint, quantity=f"RMSE against {other.upper()}")
    assert row.claim.printed() == f"{printed} % lower"
    assert row.project == f"{project}.0 % lower"
    assert row.deviation == f"{project - printed:+.1f} percentage points"


def test_a_law_that_is_worse_than_another_is_said_to_be_higher(reproduction: Reproduction) -> None:
    worse = {**reproduction, ("case1", "pidnftsm"): made_up_run("case1", "pidnftsm", 0.5)}
    row = one(compare(worse), "case1", 0, quantity="RMSE against PIDNFTSM")
    assert (row.project, row.deviation) == ("100.0 % higher", "-125.0 percentage points")


def test_statements_hold_or_not(reproduction: Reproduction) -> None:
    rows = compare(reproduction)
    assert one(rows, "case1", 0, quantity="RMSE", laws=ARTICLE_LAWS).holds is True
    against_dtsm = {"quantity": "ECI, mean |torque|", "laws": ("piddtsm", "dtsm")}
    assert one(rows, "case1", 0, **against_dtsm).holds is True
    assert one(rows, "case1", 1, **against_dtsm).holds is False  # the article has it higher in joint 2
    assert one(rows, "case2", 0, quantity="ECI, mean |torque|").holds is True
    torque = one(rows, "case2", 0, laws=("piddtsm", "pidnftsm"), printed_in="section 4, Case 2, Figure 11")
    assert torque.holds is False  # 30 and 37.5 N m are not nearly the same


def test_limits_are_those_of_the_largest_of_all_laws(reproduction: Reproduction) -> None:
    row = one(compare(reproduction), "case1", 0, quantity="largest applied torque")
    assert (row.claim.printed(), row.project, row.holds) == ("at most 100 N m", "at most 60 N m", True)
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


def test_without_runs_every_row_says_so() -> None:
    for row in compare({("case1", "dtsm"): "not finite after 0.5 s"}):
        assert "not run" in row.project or row.project == "DTSM: not finite after 0.5 s"
        assert row.deviation == NOTHING
        assert row.holds is None
        assert None in row.values


def test_a_run_without_the_event_has_no_recovery(reproduction: Reproduction) -> None:
    run = made_up_run("case1", "piddtsm")
    rows = compare({("case2", "piddtsm"): run})
    own = [
        row
        for row in rows
        if row.claim.case == "case2" and row.claim.laws == ("piddtsm",) and "recovery" in row.claim.quantity
    ]
    assert [(row.values, row.project) for row in own] == [((None,), NOTHING)] * 2


def test_the_table_has_a_line_a_row(reproduction: Reproduction) -> None:
    rows = compare(reproduction)
    head, rule, *lines = markdown(rows).splitlines()
    assert len(lines) == len(rows)
    for line in (head, rule, *lines):
        assert line.replace(r"\|", "").count("|") == 9  # 8 columns, whatever bars the texts have
    for line, row in zip(lines, rows, strict=True):
        assert row.project.replace("|", r"\|") in line
        assert row.claim.reason.replace("|", r"\|") in line


def test_the_articles_rmse_of_other_laws_follows_from_its_percentages() -> None:
    assert printed_rmse("case1") == {
        "piddtsm": [0.03808, 0.00889],
        "pidnftsm": [0.03808 / 0.75, 0.00889 / 0.54],
        "dtsm": [0.03808 / 0.5, pytest.approx(0.00889 / 0.35)],
    }
    assert printed_rmse("case2") == {"piddtsm": [0.03827, 0.00903]}


def test_a_law_has_the_same_style_whatever_runs_beside_it() -> None:
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
