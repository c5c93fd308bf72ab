"""Commissions blind arms: the description is wrong, hardware and wiring are unknown, and the truth is known only here.

    ./pidtsm shell -c "python benchmarks/commissioning.py --arms 200 --out results/commissioning.jsonl"

Six robots and three arms that this file writes, in turn; masses and inertias of each link are up to 25 % wrong; half of
the arms have one or two faults. For each arm: which faults were named, what was named that it does not have, how far it
moved beyond its limits and in the first step, and the tracking error of the set that the session keeps, relative to
that of `practical` with the wrong description, and to that of gains made with the true description and hardware. Both
are the geometric mean over the joints, on the motion of the last step. Arms that are in the file already are not
repeated; without `--arms`, the file is only summed up. With `--scenes`, each arm with shapes stands on a floor between
three boxes, which the session knows, and MuJoCo tells how hard it touches them.
"""

import argparse
import json
import re
import tempfile
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core import robots
from pidtsm_core.arrays import Array
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.simulation.clearance import Clearance
from pidtsm_studies.commissioning.arm import CommissionError, Measured, Wiring
from pidtsm_studies.commissioning.compare import own_motion
from pidtsm_studies.commissioning.gains import errors
from pidtsm_studies.commissioning.session import NAMES, Session, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm, SimulatedPort

_FOLDER = Path(robots.__file__).with_name("arms")
_TWO_LINK = Path(__file__).parents[1] / "ros2_ws/src/two_link_sim/urdf/two_link.urdf"
_CLASSES = ("collaborative", "geared", "direct_drive")
_INERTIAL = re.compile(r"<inertial>.*?</inertial>", re.DOTALL)
_NUMBER = re.compile(r'(<mass value=|\bi[xyz]{2}=)"([^"]+)"')
_WRONG = 0.25
"""Largest relative error of the mass and inertia of each link."""
_STICKS, _LOST = (0.08, 0.2), (0.01, 0.05)
"""Static beyond Coulomb friction of a joint that sticks, as a share of its effort limit; share of lost joint states."""
_ARMATURE = "robot.armature"
_ROTORS = {"collaborative": 0.005, "geared": 0.005, "direct_drive": 0.001}
"""Inertia of the rotors that the description lacks, kg m^2 per N m of the effort limit, by class of hardware."""
_FAULTS = ("inverted torque", "inverted position", "sticks", "lost")


@dataclass(frozen=True)
class Joint:
    """A joint of a written arm, with the link that it moves: a box along `length`.

    Attributes:
        kind: ``revolute`` or ``prismatic``.
        axis: of the joint, in its own frame.
        length: of its link to the next joint, m, shape (3,).
        mass: of the link, kg.
        reach: limit of the position to both sides, rad or m.
        effort: limit, N m or N.
    """

    kind: str
    axis: str
    length: tuple[float, float, float]
    mass: float
    reach: float
    effort: float


_WRITTEN = {
    "lift": (
        Joint("prismatic", "0 0 1", (0.1, 0.0, 0.1), 6.0, 0.4, 500.0),
        Joint("revolute", "0 0 1", (0.35, 0.0, 0.0), 4.0, 2.5, 80.0),
        Joint("revolute", "0 0 1", (0.25, 0.0, 0.0), 2.0, 2.5, 40.0),
        Joint("revolute", "0 1 0", (0.15, 0.0, 0.0), 1.0, 2.0, 12.0),
    ),
    "shoulder": (
        Joint("revolute", "0 0 1", (0.0, 0.0, 0.2), 5.0, 2.8, 100.0),
        Joint("revolute", "0 1 0", (0.0, 0.0, 0.4), 6.0, 2.0, 140.0),
        Joint("revolute", "0 1 0", (0.35, 0.0, 0.0), 3.0, 2.2, 60.0),
    ),
    "ceiling": (
        Joint("revolute", "0 0 -1", (0.0, 0.1, -0.15), 4.0, 2.8, 120.0),
        Joint("revolute", "0 1 0", (0.0, 0.0, -0.35), 5.0, 1.8, 120.0),
        Joint("revolute", "0 1 0", (0.3, 0.0, 0.0), 3.0, 2.2, 60.0),
        Joint("revolute", "1 0 0", (0.1, 0.0, 0.0), 1.5, 2.8, 20.0),
        Joint("revolute", "0 1 0", (0.08, 0.0, 0.0), 1.0, 1.8, 15.0),
        Joint("revolute", "1 0 0", (0.05, 0.0, 0.03), 0.6, 2.8, 8.0),
    ),
}
"""Arms of this file, by name: a column with an arm, an arm of three joints, and one that hangs."""
_ARMS = ("two_link", "panda", "lift", "ur5", "scara", "shoulder", "xarm7", "z1", "ceiling")


def written_arm(name: str) -> str:
    """The URDF of one of the arms of this file."""
    parts, parent, place = [f'<robot name="{name}"><link name="base"/>'], "base", (0.0, 0.0, 0.3)
    for j, joint in enumerate(_WRITTEN[name]):
        size = np.abs(joint.length) + 0.06
        moments = (joint.mass / 12.0 * (np.sum(size**2) - side**2) for side in size)
        xx, yy, zz = (f"{each:.6g}" for each in moments)
        centre, origin = (" ".join(f"{each:g}" for each in vector) for vector in (0.5 * np.array(joint.length), place))
        parts.append(
            f'<link name="link{j}"><inertial><origin xyz="{centre}"/><mass value="{joint.mass:g}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}{j + 1}" type="{joint.kind}"><parent link="{parent}"/><child link="link{j}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{joint.axis}"/>'
            f'<limit lower="{-joint.reach}" upper="{joint.reach}" velocity="2.5" effort="{joint.effort}"/></joint>'
        )
        parent, place = f"link{j}", joint.length
    return "".join([*parts, "</robot>"])


def true_description(name: str) -> str:
    """The URDF of an arm as it is."""
    if name in _WRITTEN:
        return written_arm(name)
    return (_TWO_LINK if name == "two_link" else _FOLDER / f"{name}.urdf").read_text(encoding="utf-8")


def wrong_description(text: str, random: np.random.Generator) -> str:
    """The URDF with other masses and inertias of each link."""

    def changed(inertial: re.Match[str]) -> str:
        factor = 1.0 + random.uniform(-_WRONG, _WRONG)
        return _NUMBER.sub(lambda each: f'{each[1]}"{float(each[2]) * factor!r}"', inertial[0])

    return _INERTIAL.sub(changed, text)


@dataclass(frozen=True)
class BlindArm:
    """An arm to commission, and the truth about it.

    Attributes:
        name, hardware: of the arm, and of its class.
        user: the description that its user has.
        true: parameters that choose the arm as it is.
        settings: true parameters of the simulator.
        wiring: true one.
        faults: its faults, each as kind and joint (-1: none in particular).
    """

    name: str
    hardware: str
    user: ArmDefinition
    true: dict[str, Any]
    settings: dict[str, Any]
    wiring: Wiring
    faults: Sequence[tuple[str, int]]


def blind_arm(seed: int, folder: Path) -> BlindArm:
    """The arm of a seed; `folder` gets its descriptions."""
    random = np.random.default_rng(seed)
    name, hardware = _ARMS[seed % len(_ARMS)], str(random.choice(_CLASSES))
    text = true_description(name)
    files = [folder / f"{name}.urdf", folder / f"{name}-true.urdf"]
    files[0].write_text(wrong_description(text, random), encoding="utf-8")
    files[1].write_text(text, encoding="utf-8")
    user, true = (ArmDefinition(str(file)) for file in files)
    arm, robot = true.settings(), true.robot()
    if "rotor_inertia" not in text:  # Its user does not know of them.
        arm[_ARMATURE] = [_ROTORS[hardware] * effort for effort in robot.effort_limit]
    middle = np.array(robot.initial_position)
    lower, upper = np.array(robot.position_limits).T if robot.position_limits else (middle - 1.0, middle + 1.0)
    spread = np.minimum(0.5 * (upper - lower), 1.0)
    position = middle + random.uniform(-0.4, 0.4, middle.size) * spread
    settings = {**arm, **hardware_settings(hardware, arm), "initial_position": position.tolist(), "seed": seed}
    wiring = Wiring.described(middle.size)
    count = seed // len(_ARMS) % 2 * int(random.choice([1, 2]))
    kinds = random.choice(_FAULTS, count, replace=False).tolist()
    joints = random.choice(middle.size, count, replace=False).tolist()
    faults = [(kind, -1 if kind == "lost" else int(j)) for kind, j in zip(kinds, joints, strict=True)]
    limit = np.array(robot.effort_limit)
    for kind, j in faults:
        if kind == "lost":
            settings["dropout.probability"] = float(random.uniform(*_LOST))
        elif kind == "sticks":
            static = np.array(settings["friction.static"])
            static[j] += float(random.uniform(*_STICKS)) * limit[j]
            settings["friction.static"] = static.tolist()
        else:
            (wiring.effort if kind == "inverted torque" else wiring.position)[j] = -1.0
    return BlindArm(name, hardware, user, arm, settings, wiring, faults)


@dataclass(frozen=True)
class WatchedArm(SimulatedArm):
    """A simulated arm of which the true way is watched in each step.

    Attributes:
        limits: positions, shape (2, joints).
        beyond: of each step so far, how far a joint was beyond its limits, rad or m.
        way: of each step so far, how far a joint was from where it began, likewise.
        force: of each step so far, the largest force of a contact, N.
    """

    limits: Array = field(default_factory=lambda: np.zeros((2, 0)))
    beyond: dict[int, float] = field(default_factory=dict)
    way: dict[int, float] = field(default_factory=dict)
    force: dict[int, float] = field(default_factory=dict)

    def port(self, step: int) -> SimulatedPort:
        """See `SimulatedArm`."""
        return _WatchedPort(self, step)


class _WatchedPort(SimulatedPort):
    def __init__(self, arm: WatchedArm, step: int) -> None:
        super().__init__(arm, step)
        self._arm, self._step, self._start = arm, step, self.truth.copy()
        arm.beyond[step], arm.way[step], arm.force[step] = 0.0, 0.0, 0.0

    def sense(self) -> Measured | None:
        """See `SimulatedPort`."""
        lower, upper = self._arm.limits
        beyond = float(np.maximum(lower - self.truth, self.truth - upper).max())
        self._arm.beyond[self._step] = max(self._arm.beyond[self._step], beyond)
        self._arm.way[self._step] = max(self._arm.way[self._step], float(np.abs(self.truth - self._start).max()))
        felt = [float(np.linalg.norm(wrench[:3])) for wrench in self._robot.contacts().values()]
        self._arm.force[self._step] = max([self._arm.force[self._step], *felt])
        return super().sense()


def written_scene(arm: dict[str, Any], seed: int, folder: Path) -> Path | None:
    """Boxes, on a floor if the arm is above it, none nearer than 5 cm where the arm begins; None: it has no shapes."""
    random, home = np.random.default_rng(seed), np.array(find_robot(arm).initial_position)
    floor = '<geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -0.05"/>'
    for attempt in range(100):
        boxes = ""
        for k in range(3):
            away, angle, high = random.uniform(0.3, 1.0), random.uniform(-np.pi, np.pi), random.uniform(0.1, 1.0)
            place = f"{away * np.cos(angle):.3f} {away * np.sin(angle):.3f} {high:.3f}"
            boxes += f'<geom name="box{k}" type="box" size="0.1 0.1 0.1" pos="{place}"/>'
        scene = folder / "scene.xml"
        below = floor if attempt < 50 else ""
        scene.write_text(f"<mujoco><worldbody>{below}{boxes}</worldbody></mujoco>", encoding="utf-8")
        try:
            clearance = Clearance(arm, str(scene), home, 0.05)
        except ParameterError:
            return None
        if clearance.is_clear(home):
            return scene
    return None


def commissioned(seed: int, folder: Path, in_scene: bool = False) -> dict[str, Any]:
    """Commission one arm in a folder, and judge the result."""
    blind = blind_arm(seed, folder)
    scene = written_scene(blind.true, seed, folder) if in_scene else None
    if scene:
        blind.settings.update({"engine": "mujoco", "scene": str(scene)})
    result: dict[str, Any] = {"seed": seed, "arm": blind.name, "hardware": blind.hardware, "faults": blind.faults}
    arm = blind.user.settings()
    before = make_experiment(
        None,
        params="practical",
        robot=blind.user,
        overrides={"simulator": {"rate": blind.settings["rate"]}},
        purpose=MEASUREMENT._replace(nodes=("controller",)),
    ).settings["controller"]
    begin = time.process_time()
    subject = Subject(arm, before, None, blind.user.described, str(scene or ""))
    session = Session.opened(folder / "session", subject)
    robot = blind.user.robot()
    given = robot.position_limits
    everything = np.full(len(blind.wiring.effort), np.inf)
    limits = np.array(given).T if given else np.array([-everything, everything])
    source = WatchedArm(blind.settings, blind.wiring, limits)
    try:
        session.run(source, lambda *_: True, lambda _: None, lambda _: None)
    except CommissionError as error:
        result["failed"] = f"{session.missing[0]}: {error}"
    result["seconds"] = time.process_time() - begin
    result["beyond"], result["way"] = max(source.beyond.values()), source.way[0]
    result["force"] = max(source.force.values()) if scene else None
    problems = [text for step in session.found.values() for text in step["problems"]]
    problems += [result["failed"]] if "failed" in result else []
    result["problems"] = problems
    result |= _named(blind, robot.joints, problems)
    if "compare" not in session.found:
        return result
    figures = session.found["compare"]["figures"]
    result |= {"better": figures["better"], "ratio": figures["ratio"], "failed_sets": figures["failed"]}
    kept = figures["error"]["new" if figures["better"] else "before"]
    truth = true_error(session, blind)
    if kept and truth is not None:
        result["to_truth"] = float(np.exp(np.mean(np.log(np.array(kept) / truth))))
    return result


_SAYS = {
    "inverted torque": r"{joint}: its (torque|position) is inverted",
    "inverted position": r"{joint}: its (torque|position) is inverted",
    "sticks": r"{joint} needs .* expect it to stick",
    "lost": r"% of the joint states are lost",
}
"""How a session names a fault: the same sentences that a user reads."""


def _named(blind: BlindArm, joints: Sequence[str], problems: Sequence[str]) -> dict[str, Any]:
    """Faults that were named, and what was named that the arm does not have."""
    said = {
        (kind, j)
        for kind, pattern in _SAYS.items()
        for j in ([-1] if kind == "lost" else range(len(joints)))
        if any(re.search(pattern.format(joint=re.escape(joints[j])), text) for text in problems)
    }
    inverted = {j for kind, j in blind.faults if kind.startswith("inverted")}
    alarms = {
        (kind.split()[0], j)
        for kind, j in said
        if (kind, j) not in blind.faults and not (kind.startswith("inverted") and j in inverted)
    }
    return {"named": [each in said for each in blind.faults], "alarms": sorted(alarms)}


def true_error(session: Session, blind: BlindArm) -> Any:
    """RMS errors with gains made with the true figures, shape (joints,); None: they fail."""
    gains = {gain.name: gain.value for gain in hardware_gains(blind.true, blind.settings)}
    loop = SimulatedArm(blind.settings, blind.wiring).follower(NAMES.index("compare"), blind.wiring)
    bench = session.bench(loop, lambda _: None)
    try:
        for _ in range(2):  # As often as the others, the first of which learns.
            samples = loop.follow({**blind.true, **gains, "limits.tracking_error": 0.3}, own_motion(bench))
    except CommissionError:
        return None
    return errors(samples.motion)


def main() -> None:
    """Commission arms, and print how good the results are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="seed of the first arm")
    parser.add_argument("--scenes", action="store_true", help="between boxes, on MuJoCo")
    parser.add_argument("--out", type=Path, default=Path("results/commissioning.jsonl"))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("a+", encoding="utf-8") as file:
        file.seek(0)
        results = {each["seed"]: each for each in map(json.loads, file)}
        for seed in range(options.first, options.first + options.arms):
            if seed not in results:
                with tempfile.TemporaryDirectory() as temporary:
                    results[seed] = commissioned(seed, Path(temporary), options.scenes)
                print(json.dumps(results[seed]), file=file, flush=True)
    _sum_up(list(results.values()))


def _sum_up(results: Sequence[dict[str, Any]]) -> None:
    done = [each for each in results if "ratio" in each]
    for each in results:
        if "failed" in each or each["alarms"] or not all(each["named"]):
            print({key: each.get(key) for key in ("seed", "arm", "hardware", "faults", "named", "alarms", "failed")})
    print(f"{len(results)} arms, {len(done)} complete, {sum(not each['faults'] for each in results)} without a fault")
    for kind in _FAULTS:
        named = [
            is_named for r in results for (k, _), is_named in zip(r["faults"], r["named"], strict=True) if k == kind
        ]
        print(f"{kind}: {sum(named)} of {len(named)} named")
    alarms = sum(bool(each["alarms"]) for each in results)
    print(f"arms with a false alarm: {alarms} ({alarms / max(len(results), 1):.1%})")
    print(
        f"farthest in the first step {max(each['way'] for each in results):.3f}, beyond limits "
        f"{max(each['beyond'] for each in results):.3f} rad or m"
    )
    forces = [each["force"] for each in results if each.get("force") is not None]
    if forces:
        print(f"in scenes: {np.count_nonzero(forces)} of {len(forces)} touched something, at most {max(forces):.1f} N")
    ratios = np.array([each["ratio"] if each["better"] and each["ratio"] else 1.0 for each in done])
    better = np.array([each["better"] for each in done])
    truths = np.array([each["to_truth"] for each in done if "to_truth" in each])
    print(f"kept set against practical: median {np.median(ratios):.2f}, better for {np.mean(better):.0%}")
    print(
        f"against true figures: median {np.median(truths):.2f}, within 1.2 for {np.mean(truths < 1.2):.0%}, at most "
        f"{truths.max():.2f}"
    )
    print(f"seconds of a session: median {np.median([each['seconds'] for each in results]):.0f}")


if __name__ == "__main__":
    main()
