"""The tuned sets of all laws are those of the tournament."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[5]
sys.path.insert(0, str(ROOT / "scripts"))


def test_they_are_the_searches_that_cost_least() -> None:
    tuned_sets = pytest.importorskip("tuned_sets", reason="needs the source checkout")
    made = {name: file.read_bytes() for name, file in tuned_sets.sources().items()}
    kept = {file.stem: file.read_bytes() for file in tuned_sets.SETS.glob("*.yaml")}
    assert kept == made, 'copy them: ./pidtsm shell -c "python scripts/tuned_sets.py"'
    assert len(kept) >= 35
