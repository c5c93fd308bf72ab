"""What a paper takes over: the table, figures that publishers accept, and the data that they draw."""

import csv
from pathlib import Path
from xml.etree import ElementTree

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import stats

from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.paper import STYLE, comparison_table, groups, write_paper_figures

SEEDS = (1, 2, 3)


@pytest.fixture(scope="module")
def runs() -> dict[str, Run]:
    made = {f"s_{seed}": rollout("noise", duration=0.3, simulator={"seed": seed}) for seed in SEEDS}
    made["50 % $x$"] = rollout("noise", "pid", duration=0.3)
    return {name: (each, each.metrics()) for name, each in made.items()}


def parameters(runs: dict[str, Run]) -> dict[str, dict[str, dict[str, object]]]:
    return {name: {node: dict(v) for node, v in run.parameters.items()} for name, (run, _) in runs.items()}


def test_runs_that_differ_in_the_seed_are_one_group(runs: dict[str, Run]) -> None:
    known = parameters(runs)
    assert groups(runs, known) == {"piddtsm": ["s_1", "s_2", "s_3"], "50 % $x$": ["50 % $x$"]}
    known["s_2"]["controller"]["law.k1"] = 3.1
    assert list(groups(runs, known)) == ["piddtsm", "s_2", "50 % $x$"]
    assert list(groups(runs, {})) == list(runs), "what is not known is not the same"


def test_the_table_has_means_and_intervals(runs: dict[str, Run]) -> None:
    text = comparison_table(runs, parameters(runs), "made by\nus")
    assert text.startswith("% made by\n% us\n\\begin{tabular}{lllrr}")
    rows = [line.removesuffix(r" \\").split(" & ") for line in text.splitlines() if line.endswith(r"\\")]
    assert rows[0][3:] == ["piddtsm ($n = 3$)", r"50 \% \$x\$"]
    assert {len(row) for row in rows} == {5}
    row = next(row for row in rows if row[0] == "RMSE")
    values = np.array([runs[f"s_{seed}"][1]["rmse"][0] for seed in SEEDS])
    low, high = stats.t.interval(0.95, 2, values.mean(), stats.sem(values))
    mean, half = map(float, row[3].strip("$").split(r" \pm "))
    assert (mean, half) == pytest.approx((values.mean(), (high - low) / 2), rel=0.05)
    assert row[2] == "rad"


def test_figures_are_vectors_with_their_data_beside_them(runs: dict[str, Run], tmp_path: Path) -> None:
    files = write_paper_figures(runs, parameters(runs), tmp_path / "figures")
    assert sorted(path.name for path in files) == [
        f"{name}.{kind}" for name in ("effort", "error", "position") for kind in ("csv", "pdf", "svg")
    ]
    again = write_paper_figures(runs, parameters(runs), tmp_path / "again")
    assert [path.read_bytes() for path in files] == [path.read_bytes() for path in again], "the same runs"
    pdf = (tmp_path / "figures" / "error.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert b"/Type3" not in pdf, "publishers refuse fonts of type 3"
    assert b"/Subtype /Image" not in pdf, "no pixels"
    texts = ["".join(each.itertext()) for each in ElementTree.parse(tmp_path / "figures" / "error.svg").iter()]
    assert any("50 % $x$" in text for text in texts)
    with (tmp_path / "figures" / "effort.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["run"], row["joint"]) == ("s_2", "joint2")]
    run = runs["s_2"][0]
    assert [float(row["time"]) for row in rows] == run.time.tolist()
    assert [float(row["effort"]) for row in rows] == run.effort[:, 1].tolist()
    assert {row["unit"] for row in rows} == {"N m"}


def test_anyone_can_use_the_style() -> None:
    with plt.style.context(STYLE):
        assert plt.rcParams["pdf.fonttype"] == 42
        assert plt.rcParams["figure.figsize"] == [3.5, 2.2]
