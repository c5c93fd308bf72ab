"""The same measured motion identified by us and by FIGAROH: error on unseen motion, time, possible bodies.

FIGAROH (PyPI) is only for this comparison, so it has an environment of its own:

    python3 -m venv peer && peer/bin/python -m pip install figaroh
    ./pidtsm shell -c "python benchmarks/identification_peer.py peer/bin/python --robot ur5 --seeds 3"

Both get the first 80 % of the raw positions and torques, and the bandwidth that ours has chosen from the data. Both
predict the torques of the rest from the same smoothed motion; the error is relative to that of the true parameters.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from identification import ROBOTS, arms, closed_loop, measurement, motions

from pidtsm_core.arrays import Array
from pidtsm_core.identification.identification import Identification, identify
from pidtsm_core.identification.least_squares import motion_regressor
from pidtsm_core.identification.measurement import Measurement, Piece, filtered
from pidtsm_core.identification.pseudo_inertia import is_consistent
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.unit_forces import LINK

_OWN = ("VIRTUAL_ENV", "PYTHONPATH", "LD_LIBRARY_PATH", "PYTHONNOUSERSITE")
"""Variables of our environment, which the other one must not see."""


def relative_error(pieces: list[Piece], truth: Array, predicted: Array) -> float:
    """Root mean square of the error of predicted torques relative to that of the true ones, over all joints."""
    measured = np.concatenate([piece.motion.effort for piece in pieces])
    usable = np.concatenate([piece.usable for piece in pieces])
    error, floor = (np.sqrt(np.mean((each - measured) ** 2, axis=0, where=usable)) for each in (predicted, truth))
    return float(np.sqrt(np.mean((error / floor) ** 2)))


def by_figaroh(
    python: str, folder: Path, known: Description, measured: Measurement, found: Identification
) -> dict[str, object]:
    """What FIGAROH predicts of the unseen torques, shape (samples, joints), its time in s, and its bodies."""
    train = measured.between(0.0, 0.8)
    pieces = filtered(measured.between(0.8, 1.0), found.cutoff, found.fit.delay)
    unseen: dict[str, Any] = {
        f"unseen_{name}": np.concatenate([getattr(piece.motion, name) for piece in pieces])
        for name in ("position", "velocity", "acceleration")
    }
    data, result = folder / "data.npz", folder / "result.npz"
    np.savez(
        data,
        urdf=known.urdf,
        joints=known.joints,
        rate=1.0 / measured.period,
        cutoff=found.cutoff,
        time=train.time,
        position=train.position,
        effort=train.effort,
        **unseen,
    )
    environment = {name: value for name, value in os.environ.items() if name not in _OWN}
    command = [python, str(Path(__file__).with_name("figaroh_identify.py")), str(data), str(result)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    with np.load(result) as content:
        return {name: content[name] for name in content.files}


def compare(python: str, folder: Path, robot: str, seed: int) -> dict[str, object]:
    """One arm."""
    true, truth, known = arms(robot, seed)
    experiment = closed_loop(folder, (true, known), *motions(robot), seed)
    measured = measurement(experiment, np.minimum(true.effort, 100.0), seed)
    begin = time.perf_counter()
    found = identify(known, [measured])
    seconds = time.perf_counter() - begin
    pieces = list(filtered(measured.between(0.8, 1.0), found.cutoff, found.fit.delay))
    matrix = np.concatenate([motion_regressor(found.arm.tree, piece.motion) for piece in pieces])
    other = by_figaroh(python, folder, known, measured, found)
    links = found.parameters[: LINK * len(known.joints)].reshape(-1, LINK)
    return {
        "robot": robot,
        "seed": seed,
        "ours": {
            "error": relative_error(pieces, matrix @ truth, matrix @ found.parameters),
            "seconds": seconds,
            "possible": all(is_consistent(each) for each in links),
        },
        "figaroh": {
            "error": relative_error(pieces, matrix @ truth, np.asarray(other["predicted"])),
            "seconds": float(np.asarray(other["seconds"])),
            "bodies": json.loads(str(other["fit"])),
        },
        "description": relative_error(pieces, matrix @ truth, matrix @ found.described),
    }


def main() -> None:
    """Print one JSON object per arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python", help="interpreter of the environment with FIGAROH")
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for robot in options.robot or ROBOTS:
            for seed in range(options.seeds):
                print(json.dumps(compare(options.python, Path(folder), robot, seed)), flush=True)


if __name__ == "__main__":
    main()
