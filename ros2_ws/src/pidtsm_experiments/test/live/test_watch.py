"""The table of metrics on the live page."""

import re

import numpy as np

from pidtsm_core.recording.metric import MEAN_EFFORT, RMSE
from pidtsm_core.units import SLIDES, TURNS
from pidtsm_experiments.live.watch import metrics_table


def rows(table: str) -> list[list[str]]:
    """The text of each cell, by row."""
    return [
        [" ".join(re.sub("<[^>]+>", " ", cell).split()) for cell in re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row)]
        for row in re.findall(r"<tr>(.*?)</tr>", table)
    ]


def test_a_column_has_one_unit_in_its_head() -> None:
    errors, kept, efforts = np.array([2.5e-3, 3e-7]), np.array([0.5, 1e-17]), np.array([12.0, 0.25])
    columns = [("RMSE of A", RMSE, kept), ("RMSE", RMSE, errors), ("ECI", MEAN_EFFORT, efforts)]
    assert rows(metrics_table(["a", "<b>"], [TURNS, TURNS], columns)) == [
        ["since the mark", "RMSE of A mrad", "RMSE mrad", "ECI N m"],
        ["a", "500", "2.5", "12"],
        ["&lt;b&gt;", "0", "3 × 10⁻⁴", "0.25"],
    ]


def test_joints_that_turn_and_slide_have_their_units() -> None:
    columns = [("RMSE", RMSE, np.array([2.5e-3, 3e-6])), ("ECI", MEAN_EFFORT, np.zeros(0))]
    assert rows(metrics_table(["a", "b"], [TURNS, SLIDES], columns)) == [
        ["since the mark", "RMSE mrad or µm"],
        ["a", "2.5"],
        ["b", "3"],
    ]
