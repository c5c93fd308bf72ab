"""Publishes a finished tournament: its tables and figures in docs/, and beside them the data that they are made of.

./pidtsm shell -c "python scripts/leaderboard.py results/tournament"
"""

import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
DATA = DOCS / "tournament"
_FIGURES = "images/leaderboard-*.png"
_TABLES = ("leaderboard.md", "tournament.md", _FIGURES)
_KEPT = ("tournament.json", "score/**/score.json", "tune/**/params.yaml", "tune/**/tuning.json")


def main(tournament: Path) -> None:
    """Replace the published tournament by the one in a result folder."""
    shutil.rmtree(DATA, ignore_errors=True)
    for old in DOCS.glob(_FIGURES):
        old.unlink()
    for patterns, target in ((_TABLES, DOCS), (_KEPT, DATA)):
        for file in sorted(found for pattern in patterns for found in tournament.glob(pattern)):
            copy = target / file.relative_to(tournament)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
