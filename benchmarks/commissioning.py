"""Commissions blind arms: the description is wrong, hardware and wiring are unknown, and the truth is known only here.

    ./pidtsm shell -c "python benchmarks/commissioning.py --arms 200 --out results/commissioning.jsonl"

For each arm: whether the wiring was found, and the tracking error of the set that the session keeps, relative to that
of `practical` with the wrong description, and to that of gains made with the true description and hardware. Both are
the geometric mean over the joints, on the motion of the last step.
"""

import argparse
import json
import re
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core import robots
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.arm import CommissionError, Wiring
from pidtsm_studies.commissioning.compare import own_motion
from pidtsm_studies.commissioning.gains import errors
from pidtsm_studies.commissioning.session import NAMES, Session, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm

_FOLDER = Path(robots.__file__).with_name("arms")
_ARMS = ("panda", "ur5", "xarm7", "z1")
_CLASSES = ("collaborative", "geared", "direct_drive")
_INERTIAL = re.compile(r"<inertial>.*?</inertial>", re.DOTALL)
_NUMBER = re.compile(r'(<mass value=|\bi[xyz]{2}=)"([^"]+)"')
_WRONG = 0.25
"""Largest relative error of the mass and inertia of each link."""


def wrong_description(text: str, random: np.random.Generator) -> str:
    """The URDF with other masses and inertias of each link."""

    def changed(inertial: re.Match[str]) -> str:
        factor = 1.0 + random.uniform(-_WRONG, _WRONG)
        return _NUMBER.sub(lambda each: f'{each[1]}"{float(each[2]) * factor!r}"', inertial[0])

    return _INERTIAL.sub(changed, text)


def blind_arm(seed: int, folder: Path) -> tuple[str, str, ArmDefinition, dict[str, Any], Wiring]:
    """Name and class, the description that its user has, its true parameters of the simulator, and its wiring."""
    random = np.random.default_rng(seed)
    name, hardware = _ARMS[seed % len(_ARMS)], str(random.choice(_CLASSES))
    true = ArmDefinition(name)
    file = folder / f"{name}.urdf"
    file.write_text(wrong_description((_FOLDER / file.name).read_text(encoding="utf-8"), random), encoding="utf-8")
    definition = ArmDefinition(str(file))
    arm = true.settings()
    robot = true.robot()
    middle = np.array(robot.initial_position)
    lower, upper = np.array(robot.position_limits).T if robot.position_limits else (middle - 1.0, middle + 1.0)
    spread = np.minimum(0.5 * (upper - lower), 1.0)
    position = middle + random.uniform(-0.4, 0.4, middle.size) * spread
    settings = {**arm, **hardware_settings(hardware, arm), "initial_position": position.tolist(), "seed": seed}
    wiring = Wiring.described(middle.size)
    if seed % 2:
        wiring.effort[int(random.integers(middle.size))] = -1.0
    return name, hardware, definition, settings, wiring


def commissioned(seed: int, folder: Path) -> dict[str, Any]:
    """Commission one arm in a folder, and judge the result."""
    name, hardware, definition, settings, wiring = blind_arm(seed, folder)
    result: dict[str, Any] = {"seed": seed, "arm": name, "hardware": hardware, "inverted": not wiring.is_described}
    arm = definition.settings()
    before = make_experiment(
        None,
        params="practical",
        robot=definition,
        overrides={"simulator": {"rate": settings["rate"]}},
        purpose=MEASUREMENT._replace(nodes=("controller",)),
    ).settings["controller"]
    begin = time.monotonic()
    session = Session.opened(folder / "session", Subject(arm, before, None, definition.described))
    source = SimulatedArm(settings, wiring)
    try:
        session.run(source, lambda *_: True, lambda _: None, lambda _: None)
    except CommissionError as error:
        result["failed"] = f"{session.missing[0]}: {error}"
    result["seconds"] = time.monotonic() - begin
    found = session.found.get("signs", {}).get("figures")
    if found:
        result["wired"] = np.array_equal(np.multiply(found["position"], found["effort"]), wiring.effort)
        result["moved"] = max(found["moved"])
    if "compare" not in session.found:
        return result
    figures = session.found["compare"]["figures"]
    result |= {"better": figures["better"], "ratio": figures["ratio"], "failed_sets": figures["failed"]}
    kept = figures["error"]["new" if figures["better"] else "before"]
    truth = true_error(session, name, settings, wiring)
    if kept and truth is not None:
        result["to_truth"] = float(np.exp(np.mean(np.log(np.array(kept) / truth))))
    return result


def true_error(session: Session, name: str, settings: dict[str, Any], wiring: Wiring) -> Any:
    """RMS errors with gains made with the true figures, shape (joints,); None: they fail."""
    true = ArmDefinition(name).settings()
    gains = {gain.name: gain.value for gain in hardware_gains(true, settings)}
    loop = SimulatedArm(settings, wiring).follower(NAMES.index("compare"), wiring)
    bench = session.bench(loop, lambda _: None)
    try:
        for _ in range(2):  # As often as the others, the first of which learns.
            samples = loop.follow({**true, **gains, "limits.tracking_error": 0.3}, own_motion(bench))
    except CommissionError:
        return None
    return errors(samples.motion)


def main() -> None:
    """Commission arms, and print how good the results are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first arm")
    parser.add_argument("--out", type=Path, default=Path("results/commissioning.jsonl"))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    results = []
    with options.out.open("a", encoding="utf-8") as file:
        for seed in range(options.first, options.first + options.arms):
            with tempfile.TemporaryDirectory() as temporary:
                results.append(commissioned(seed, Path(temporary)))
            print(json.dumps(results[-1]), file=file, flush=True)
    done = [each for each in results if "ratio" in each]
    ratios = np.array([each["ratio"] if each["better"] and each["ratio"] else 1.0 for each in done])
    truths = np.array([each["to_truth"] for each in done if "to_truth" in each])
    wired = sum(each.get("wired", False) for each in results)
    print(f"{len(results)} arms, {len(done)} complete, wiring right: {wired}")
    print(f"kept set against practical: median {np.median(ratios):.2f}, better for {np.mean(ratios < 1.0):.0%}")
    print(f"against true figures: median {np.median(truths):.2f}, within 1.2 for {np.mean(truths < 1.2):.0%}")
    print(f"seconds of a session: median {np.median([each['seconds'] for each in results]):.0f}")


if __name__ == "__main__":
    main()
