"""A run as a table, judged by the csv module."""

import csv
from pathlib import Path

import numpy as np
import pytest

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.saved import read_run


def test_every_number_is_in_the_table_to_the_last_bit(kept: Path, folder: Path) -> None:
    assert main(["export", str(kept / "firm"), "--csv", "firm.csv"]) == 0
    with (folder / "firm.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    run = read_run(kept / "firm")
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    np.testing.assert_array_equal(table["time"], run.time)
    for name, array in run.arrays().items():
        for j, joint in enumerate(run.joints):
            np.testing.assert_array_equal(table[f"{name}.{joint}"], array[:, j])
    assert len(header) == 1 + len(run.arrays()) * len(run.joints)


@pytest.mark.parametrize(
    ("run", "file", "cause"),
    [("nothing", "run.csv", "nothing"), ("firm", "no/run.csv", "--csv no/run.csv"), ("firm", ".", "is a folder")],
)
def test_what_cannot_be_read_or_written_is_named(
    kept: Path, folder: Path, run: str, file: str, cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(kept / run), "--csv", file]) == 2
    assert cause in capsys.readouterr().err
    assert not [*folder.iterdir()]
