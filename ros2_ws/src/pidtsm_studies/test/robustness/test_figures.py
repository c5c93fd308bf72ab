"""Figures of the robustness study: one panel per metric, estimators on the left, laws on the right."""

from pathlib import Path

import numpy as np
import pytest

from pidtsm_studies.robustness import figures
from pidtsm_studies.robustness.contenders import CONTENDERS, ESTIMATORS, LABELS, LAWS
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS
from pidtsm_studies.robustness.results import Robustness


def test_each_imperfection_has_its_files(tmp_path: Path, quick: Robustness, monkeypatch: pytest.MonkeyPatch) -> None:
    two = IMPERFECTIONS[:2]  # drawing takes a second each
    monkeypatch.setattr(figures, "IMPERFECTIONS", two)
    written = figures.write_robustness_figures(quick, tmp_path / "figures")
    assert [path.name for path in written] == [f"{each.name}.{kind}" for each in two for kind in ("png", "svg")]
    for path, imperfection in zip(written[1::2], two, strict=True):
        svg = path.read_text(encoding="utf-8")
        assert imperfection.label in svg
        for text in (*LABELS.values(), "success rate", "RMSE (rad)", "the proposed law, by estimator", "all laws"):
            assert text in svg


def test_every_contender_is_drawn_in_a_style_of_its_own() -> None:
    assert {*ESTIMATORS, *LAWS} == {contender.name for contender in CONTENDERS} == set(figures.STYLES)
    assert len({colour for colour, _ in figures.STYLES.values()}) == len(CONTENDERS)
    assert len({str(dashes) for _, dashes in figures.STYLES.values()}) == len(CONTENDERS)


def test_a_band_has_gaps_where_runs_diverged(with_failures: Robustness) -> None:
    curve = with_failures.curves["encoder"]["practical"]
    for panel in ("rmse", "eci", "torque_variation"):
        low, middle, high = figures.band(curve, panel)
        for values in (low, middle, high):
            assert [index for index, value in enumerate(values) if np.isnan(value)] == [3]
    low, middle, high = figures.band(with_failures.curves["noise"]["practical"], "success")
    assert (low < middle).all()
    assert (middle <= high).all()
