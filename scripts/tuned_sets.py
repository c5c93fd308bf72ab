"""Copies the gains of the tournament into pidtsm_core, as the sets `tuned` of every law: the search that cost least.

./pidtsm shell -c "python scripts/tuned_sets.py"
"""

import json
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TOURNAMENT = ROOT / "docs" / "tournament" / "tune"
SETS = ROOT / "ros2_ws" / "src" / "pidtsm_core" / "pidtsm_core" / "experiment" / "params" / "tuned" / "laws"


def sources() -> dict[str, Path]:
    """Parameter file of the tournament for each set, by the name of the set: ROBOT-HARDWARE-LAW.

    Of the searches of a law, that with the least cost in training counts: unseen conditions choose nothing.
    """
    best: dict[str, tuple[float, Path]] = {}
    for file in sorted(TOURNAMENT.glob("*/*/seed-*/tuning.json")):
        content = json.loads(file.read_text(encoding="utf-8"))
        name = f"{content['robot']}-{content['hardware']}-{content['law']}"
        found = (content["cost"]["training"]["after"], file.with_name("params.yaml"))
        best[name] = min(best.get(name, found), found)
    return {name: file for name, (_, file) in best.items()}


if __name__ == "__main__":
    shutil.rmtree(SETS, ignore_errors=True)
    SETS.mkdir(parents=True)
    for name, file in sources().items():
        shutil.copyfile(file, SETS / f"{name}.yaml")
