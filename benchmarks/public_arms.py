"""Tries the commands on arms that nobody here chose: descriptions from public packages, which it fetches.

./pidtsm shell -c "python benchmarks/public_arms.py --out results/public_arms"

For each arm: `check`, `gains`, a rollout with 14-bit encoders and 1 ms of delay, `excite`, `identify` on that
motion, the planning of `move` to random targets, rounded as a person types them, and, with ``--nodes``, `nodes start`
with a simulated arm and `move` to some of them. What a message proposes (``--joints``, ``--effort``,
``robot.armature``) is followed literally. A run that is interrupted is resumed by the same command.
"""

import argparse
import contextlib
import io
import json
import re
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.timing import retime
from pidtsm_experiments.cli import main

PACKAGES = ("example-robot-data==6.0.0", "robosuite==1.5.2", "gymnasium==1.4.0")
_DATA = "cmeel.prefix/share/example-robot-data/robots"
ARMS = (
    *(
        f"{_DATA}/{file}"
        for file in (
            "baxter_description/urdf/baxter.urdf",
            "talos_data/robots/talos_left_arm.urdf",
            "talos_data/robots/talos_full_v2.urdf",
            "tiago_description/robots/tiago.urdf",
            "tiago_pro_description/robots/tiago_pro.urdf",
            "so_arm_description/urdf/so101.urdf",
            "so_arm_description/urdf/so100.urdf",
            "kinova_description/robots/kinova.urdf",
            "ur_description/urdf/ur3_robot.urdf",
            "ur_description/urdf/ur5_gripper.urdf",
            "ur_description/urdf/ur10_robot.urdf",
            "panda_description/urdf/panda.urdf",
            "z1_description/urdf/z1.urdf",
            "xarm_description/urdf/xarm7.urdf",
            "pr2_description/urdf/pr2.urdf",
            "g1_description/urdf/g1_29dof_rev_1_0.urdf",
            "alex_description/urdf/alex_sake_hands.urdf",
            "simple_humanoid_description/urdf/simple_humanoid.urdf",
            "asr_twodof_description/urdf/TwoDofs.urdf",
        )
    ),
    *(
        f"robosuite/models/assets/robots/{name}/robot.xml"
        for name in ("tiago", "baxter", "iiwa", "sawyer", "ur5e", "kinova3", "jaco", "spot_arm", "panda", "xarm7")
    ),
    "gymnasium/envs/mujoco/assets/pusher_v5.xml",
)
"""Files below the folder of the packages."""
SENSORS = ("--set", "simulator.encoder.bits=14", "--set", "simulator.delay.samples=1")
_ARMATURE = "0.05"
"""kg m^2, where a message requires rotors."""
_CURES = 3
_SHOWN = ("rollout", "check", "gains", "excite", "identify", "targets", "refused", "arrived")
_TARGETS = 400
"""Random targets for each arm, more than 10,000 in all."""
_MOVES, _NEAR = 5, 0.02
"""Targets to which the arm moves on nodes; the largest error there, rad or m."""


def fetch(folder: Path) -> None:
    """Unpack the packages into a folder, without what they depend on."""
    command = ["uv", "pip", "install", "-q", "--no-deps", "--target", str(folder), *PACKAGES]
    subprocess.run(command, check=True)


def call(words: Sequence[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a command; an exception ends the benchmark, because no input may cause one."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = main(list(words))
    return code, output.getvalue(), errors.getvalue()


def cured(words: list[str]) -> tuple[int, str, str, list[str]]:
    """Call a command; if it is refused with a cure, again with that, which is returned, too."""
    more: list[str] = []
    for _ in range(1 + _CURES):
        code, output, errors = call([*words, *more])
        proposed = list(_proposed(errors, more)) if code else []
        if not proposed:
            break
        more += proposed
    return code, output, errors, more


def _proposed(errors: str, more: Sequence[str]) -> Iterator[str]:
    """Options that a message proposes and that are not followed yet."""
    for option in ("--joints", "--effort"):
        if option not in more and (found := re.search(rf"{option} (?!and |or )(\S+)", errors)):
            yield from (option, found[1].replace("LIMIT", "50").rstrip(".,;)"))
            return
    if "robot.armature" in errors and "--set" not in more:
        for node in ("simulator", "controller"):
            yield from ("--set", f"{node}.robot.armature={_ARMATURE}")


def tried(file: Path, folder: Path, nodes: bool) -> dict[str, Any]:
    """What came of every command for one arm."""
    folder.mkdir(parents=True, exist_ok=True)
    robot: list[str] = ["--robot", str(file)]
    row: dict[str, Any] = {}
    began = time.perf_counter()
    code, output, errors, cure = cured(["rollout", *robot, *SENSORS, "--duration", "8", "--json"])
    row |= {"rollout": code, "cure": cure, "messages": errors.strip().splitlines()[-1:] if code else []}
    if code in (0, 1) and output:
        metrics = json.loads(output)
        row |= {"joints": len(metrics["joints"]), "outcome": metrics["outcome"]}
        row["error"] = max(metrics["steady_state_error"])
    row["advice"] = list(_proposed(errors, cure))
    arm = _arm_words(cure)
    code, output, errors = call(["check", str(file), *arm, "--json"])
    doubts = json.loads(output)["doubts"] if output else []
    row |= {"check": code, "doubts": [doubt["code"] for doubt in doubts]}
    row["advice"] += _proposed(" ".join(doubt["cure"] for doubt in doubts), [*cure, *row["advice"]])
    row["gains"] = call(["gains", *robot, *arm])[0]
    motion, moved = str(folder / "motion.yaml"), str(folder / "moved")
    row["excite"], _, errors = call(["excite", *robot, *arm, "--duration", "20", "--out", motion])
    if row["excite"] == 0:
        with_sensors = ["rollout", "--scenario", motion, *SENSORS, *_sets(cure)]
        row["moved"], _, errors = call([*with_sensors, "--bag", "--out", moved])
        bag = Path(moved) if Path(moved).exists() else Path(f"{moved}.failed")
        code, output, errors = call(
            ["identify", str(bag / "bag"), *robot, *arm, "--out", str(folder / "identified"), "--json"]
        )
        row |= {"identify": code, "warnings": json.loads(output)["warnings"] if output else errors.strip()}
    if "error" in row:
        row |= planned(file, arm)
        row |= driven(file, [*cure, *row["advice"]]) if nodes else {}
    return {**row, "seconds": round(time.perf_counter() - began, 1)}


def arm_of(file: Path, options: Sequence[str]) -> ArmDefinition:
    """The arm of a file with the options ``--joints`` and ``--effort``."""
    words = dict(zip(options[::2], options[1::2], strict=True))
    efforts = tuple(float(each) for each in words.get("--effort", "").split(",") if each and "=" not in each)
    named = dict(pair.split("=") for pair in words.get("--effort", "").split(",") if "=" in pair)
    joints = tuple(words["--joints"].split(",")) if "--joints" in words else ()
    return ArmDefinition(str(file), joints, effort=efforts or {name: float(value) for name, value in named.items()})


def driven(file: Path, cure: Sequence[str]) -> dict[str, Any]:
    """Start nodes with a simulated arm and move it to random targets about its start, one after the other.

    Args:
        file: the arm.
        cure: options that messages have proposed.
    """
    options = _arm_words(cure)
    program = [str(Path(__file__).parents[1] / "pidtsm")]
    arm = [*program, "nodes", "start", "--plant", "--detach", "--robot", str(file), *options]
    started = subprocess.run([*arm, *_sets(cure)], capture_output=True, text=True, check=False)
    if started.returncode:
        return {"arrived": 0, "moves": [started.stderr.strip()]}
    limits, start = (
        motion_limits(arm_of(file, options).settings()),
        np.array(arm_of(file, options).robot().initial_position),
    )
    random, messages = np.random.default_rng(1), list[str]()
    try:
        for _ in range(_MOVES):
            target = np.clip(np.round(start + random.uniform(-0.4, 0.4, start.size), 2), limits.lower, limits.upper)
            words = [*program, "move", "--json", "--to", *(f"{q:g}" for q in target)]
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            found = json.loads(done.stdout)["position"].values() if done.returncode == 0 else [np.inf]
            near = done.returncode == 0 and np.abs(np.array([*found]) - target).max() < _NEAR
            messages.append("" if near else done.stderr.strip() or str(found))
    finally:
        subprocess.run([*program, "nodes", "stop"], capture_output=True, check=False)
    return {"arrived": messages.count(""), "moves": messages}


def planned(file: Path, options: Sequence[str]) -> dict[str, Any]:
    """Plan motions between random postures; an exception other than a refusal ends the benchmark."""
    limits = motion_limits(arm_of(file, options).settings())
    low, high = (np.clip(each, -np.pi, np.pi) for each in (limits.lower, limits.upper))
    random, refused, times = np.random.default_rng(0), list[str](), list[float]()
    for _ in range(_TARGETS):
        ends = np.clip(np.round(random.uniform(low, high, (2, low.size)), 2), low, high)
        began = time.perf_counter()
        try:
            retime(ends, limits)
        except TrajectoryError as error:
            refused.append(str(error))
        times.append(time.perf_counter() - began)
    return {
        "targets": _TARGETS,
        "refused": len(refused),
        "refusals": refused[:3],
        "planning_ms": [round(1e3 * float(np.quantile(times[1:], share)), 2) for share in (0.5, 0.99, 1.0)],
    }


def _arm_words(words: Sequence[str]) -> list[str]:
    """The options among words that choose joints and their efforts."""
    return [word for option in ("--joints", "--effort") if option in words for word in _pair(words, option)]


def _sets(words: Sequence[str]) -> list[str]:
    """The options ``--set`` among words, with their values."""
    return [word for i, word in enumerate(words) if "--set" in (word, *words[max(0, i - 1) : i])]


def _pair(words: Sequence[str], option: str) -> Sequence[str]:
    place = words.index(option)
    return words[place : place + 2]


def try_all() -> None:
    """Fetch, try, and print one line for each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="results and fetched packages")
    parser.add_argument("--nodes", action="store_true", help="move the arms on nodes, too, in real time")
    options = parser.parse_args()
    packages, results = options.out / "packages", options.out / "arms.json"
    if not packages.exists():
        fetch(packages)
    rows: dict[str, Any] = json.loads(results.read_text(encoding="utf-8")) if results.exists() else {}
    for name in ARMS:
        if name not in rows:
            rows[name] = tried(packages / name, options.out / name.replace("/", "_"), options.nodes)
            results.write_text(json.dumps(rows, indent=1), encoding="utf-8")
        row = rows[name]
        error = f"{1e3 * row['error']:.2f} mrad or mm" if "error" in row else "-"
        codes = " ".join(f"{key} {row[key]}" for key in _SHOWN if key in row)
        print(f"{Path(name).parent.name}/{Path(name).name}: {codes}; {error}; {row.get('doubts')}", flush=True)


if __name__ == "__main__":
    try_all()
