"""How often `diagnose` is right, on recordings of blind arms, by cause; on strangers' bags as well as on ours.

    ./pidtsm shell -c "python benchmarks/diagnosis.py --count 300 --folder results/labelled"

Every recording is that of a blind arm. Of five, one has no fault, three have one, and one has two; causes, arms and
origins take turns, so that each cause is there as often as any other. Of ten recordings, four are bags of rollouts, of
which those with faults that a rollout's bag does not show are what a recorder at our nodes would see, as are three
more; one is of MuJoCo instead of our equations, one is such a bag with joint states, commands and references alone,
written by rosbags, and one is a bag of our nodes. The folder keeps the recordings: the same command judges them again
in a minute. A recording in which the loop follows for less than 4 s is made again with another arm.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys.store import Typestore

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots import find_description
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.observed import read_observed
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag
from pidtsm_experiments.runs.runner import run
from pidtsm_studies.blind.arms import ARMS, BlindArm, blind_arm
from pidtsm_studies.blind.faults import compatible
from pidtsm_studies.blind.observe import observe
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.diagnose import diagnose
from pidtsm_studies.diagnosis.observed import Observed

_SHORTEST = 4.0
_DURATIONS = (12.0, 12.0, 20.0, 12.0, 30.0)
_ROLLOUT, _RECORDER, _MUJOCO, _STRANGER, _NODES = "rollout --bag", "recorder", "mujoco", "stranger's bag", "nodes"
_ORIGINS = (_ROLLOUT, _RECORDER, _MUJOCO, _ROLLOUT, _RECORDER, _NODES, _ROLLOUT, _RECORDER, _STRANGER, _ROLLOUT)
_RINGING = ("collaborative", "geared", "hobby")
"""Classes of hardware whose loops can be made to ring."""
_UNSEEN = {Cause.NOISY_ENCODER, Cause.LOST_SAMPLES, Cause.LATE_DRIVE}
"""What a rollout's bag, which has the truth instead of measurements, does not show."""
_GOOD, _PAIR, _CYCLE = 0, 4, 5
"""Of so many recordings, the one without a fault and the one with two."""


@dataclass(frozen=True)
class Label:
    """What is known of a recording: its place, seed, arm, class of hardware, origin, and its faults with their text."""

    place: int
    seed: int
    arm: str
    hardware: str
    origin: str
    truth: dict[str, str]


def _schedule(count: int) -> Iterator[tuple[list[Cause], int, str]]:
    """Causes, place of the arm among `ARMS`, and origin of each recording."""
    every = list(Cause)
    planted: Counter[Cause] = Counter()
    pairs = [list(pair) for pair in combinations(every, 2) if compatible(pair)]
    used: Counter[tuple[Cause, ...]] = Counter()
    singles = 0
    for i in range(count):
        turn = i // _CYCLE
        causes: list[Cause] = []
        if i % _CYCLE == _PAIR:
            causes = min(pairs, key=lambda pair: (used[tuple(pair)], sum(planted[cause] for cause in pair)))
            used[tuple(causes)] += 1
            planted.update(causes)
        elif i % _CYCLE != _GOOD:
            causes, turn = [every[singles % len(every)]], singles // len(every) + singles
            singles += 1
        origin = _ORIGINS[turn % len(_ORIGINS)]
        if origin == _ROLLOUT and _UNSEEN & set(causes):
            origin = _RECORDER
        yield causes, turn + turn // len(_ORIGINS), origin


def _made(place: int, first: int, causes: Sequence[Cause], arm: int, origin: str, folder: Path) -> None:
    """Record a blind arm, and keep recording and label; where a fault would not matter for an arm, the next is taken.

    Raises:
        UsageError: it matters for none.
    """
    began = time.process_time()
    for attempt in range(2 * len(ARMS)):
        name, seed = ARMS[(arm + attempt) % len(ARMS)], first + place + 10_000 * (attempt // len(ARMS))
        with tempfile.TemporaryDirectory() as temporary:
            try:
                hardware = _RINGING[place % len(_RINGING)] if Cause.RINGING in causes else None
                made = blind_arm(
                    seed, Path(temporary), name, causes, hardware, _DURATIONS[place // 2 % len(_DURATIONS)]
                )
                seen = _recording(made, origin, Path(temporary))
            except (UsageError, DivergedError, _TooShortError) as error:
                print(f"{place}: {str(error)[:120]}", flush=True)
                continue
        truth = {each.cause.value: each.text for each in made.truth}
        label = Label(place, seed, name, made.hardware, origin, truth)
        np.savez(folder / f"{place:04}.npz", **{key: value for key, value in vars(seen).items() if value is not None})
        (folder / f"{place:04}.json").write_text(json.dumps(asdict(label)), encoding="utf-8")
        print(f"{place}: {origin}, {name}, {list(truth)}, {time.process_time() - began:.1f} s", flush=True)
        return
    raise UsageError(f"{[cause.value for cause in causes]} matter for no arm")


def _recording(made: BlindArm, origin: str, folder: Path) -> Observed:
    """What is seen of a blind arm."""
    experiment = made.experiment
    bag = folder / "bag"
    if origin == _ROLLOUT:
        write_rollout_bag(rollout(experiment), experiment.values["trajectory"], bag)
        return _long(read_observed(bag)[0])
    if origin == _NODES:
        return _long(read_observed(run(experiment, "lockstep", folder, lambda _: None))[0])
    if origin == _RECORDER:
        return _long(observe(experiment))
    seen = _long(observe(make_experiment(experiment, overrides={"simulator": {"engine": "mujoco"}})))
    if origin == _STRANGER:
        _write(bag, seen)
        return read_observed(bag)[0]
    return seen


class _TooShortError(Exception):
    """The loop follows for too short a time."""


def _long(seen: Observed) -> Observed:
    """A recording, if its loop follows long enough."""
    if seen.following is not None and np.count_nonzero(seen.following) * seen.period < _SHORTEST:
        raise _TooShortError(f"{seen.stopped} after less than {_SHORTEST:g} s")
    return seen


def _kept(folder: Path, place: int) -> tuple[Label, Observed]:
    label = Label(**json.loads((folder / f"{place:04}.json").read_text(encoding="utf-8")))
    with np.load(folder / f"{place:04}.npz") as file:
        content = {key: file[key] for key in file.files}
    for key in ("joints", "slides"):
        content[key] = tuple(content[key].tolist())
    return label, Observed(**{**content, "stopped": str(content["stopped"])})


def main() -> None:
    """Make the recordings that are missing, judge them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first", type=int, default=20_000, help="first seed")
    parser.add_argument("--folder", type=Path, default=Path("results/labelled"), help="of the recordings")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for place, (causes, arm, origin) in enumerate(_schedule(options.count)):
        if not (options.folder / f"{place:04}.json").exists():
            try:
                _made(place, options.first, causes, arm, origin, options.folder)
            except UsageError as error:
                print(f"{place}: {error}", flush=True)
    _judge(options.folder)


def _judge(folder: Path) -> None:
    """Judge all recordings of a folder, and print how often the diagnosis is right."""
    planted, named, wrongly = Counter[str](), Counter[str](), Counter[tuple[str, str]]()
    kinds: dict[str, list[bool]] = {}
    took = []
    for file in sorted(folder.glob("*.json")):
        label, seen = _kept(folder, int(file.stem))
        began = time.process_time()
        diagnosis = diagnose(seen, find_description(ArmDefinition(label.arm).settings()))
        took.append((time.process_time() - began) * 30.0 / (seen.time[-1] - seen.time[0]))
        truth, found = set(label.truth), {each.cause.value for each in diagnosis.found}
        planted.update(truth)
        named.update(truth & found)
        missed, extra = sorted(truth - found) or ["nothing missed"], sorted(found - truth) or ["nothing"]
        if found != truth:
            wrongly.update((a, b) for a in missed for b in extra)
            print(f"{label} -> {sorted(found)}", flush=True)
        for kind in ("all", label.origin, f"{len(truth)} faults", label.hardware or "ideal"):
            kinds.setdefault(kind, []).append(found == truth)
    print(json.dumps({cause.value: f"{named[cause.value]} of {planted[cause.value]}" for cause in Cause}, indent=1))
    print("missed -> named instead:", {f"{a} -> {b}": count for (a, b), count in wrongly.most_common()})
    print({kind: f"{sum(each)} of {len(each)} ({np.mean(each):.1%})" for kind, each in kinds.items()})
    print(f"30 s of data take {np.mean(took):.2f} s of processor, at most {np.max(took):.2f} s")


def _write(folder: Path, seen: Observed) -> None:
    """The bag of somebody who records joint states, commands and references, all of type JointState."""
    store = typestore()
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, position, effort in _topics(seen):
            connection = bag.add_connection(topic, "sensor_msgs/msg/JointState", typestore=store)
            for k, stamp in enumerate(np.round(seen.time * 1e9).astype(np.int64).tolist()):
                bag.write(connection, stamp, _message(store, seen.joints, stamp, position, effort, k))


def _topics(seen: Observed) -> Iterator[tuple[str, Array | None, Array | None]]:
    yield "/arm/joint_states", seen.position, seen.effort
    yield "/arm/joint_commands", None, seen.command
    yield "/arm/reference", seen.reference, None


def _message(
    store: Typestore, joints: tuple[str, ...], stamp: int, position: Array | None, effort: Array | None, k: int
) -> bytes:
    types, none = store.types, np.empty(0)
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "")
    values = (none if position is None else position[k], none, none if effort is None else effort[k])
    message = types["sensor_msgs/msg/JointState"](header, list(joints), *values)
    return bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState"))


if __name__ == "__main__":
    main()
