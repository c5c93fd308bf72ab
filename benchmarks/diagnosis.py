"""How often `diagnose` is right, on recordings of blind arms, by cause; on strangers' bags as well as on ours.

    python benchmarks/diagnosis.py --count 300

Every recording is that of a blind arm: every third without a fault, most with one, some with two. Of ten, one is a
rollout with its bag, and two are made by MuJoCo instead of our equations; of these, one is a bag with joint states,
commands and references alone, written by rosbags. The rest is what a recorder at our nodes would see. A recording in
which the loop follows for less than 4 s is not judged; the table counts these.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys.store import Typestore

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots import find_description
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.observed import read_observed
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag
from pidtsm_studies.blind.arms import BlindArm, blind_arm
from pidtsm_studies.blind.faults import compatible
from pidtsm_studies.blind.observe import observe
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.diagnose import diagnose
from pidtsm_studies.diagnosis.observed import Observed

_SHORTEST = 4.0
_DURATIONS = (12.0, 20.0, 30.0)
_UNSEEN = {Cause.NOISY_ENCODER, Cause.LOST_SAMPLES, Cause.LATE_DRIVE}
"""What a rollout's bag, which has the truth instead of measurements, does not show."""


def main() -> None:
    """Make the recordings, judge them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first", type=int, default=20_000, help="first seed")
    parser.add_argument("--quiet", action="store_true", help="without the recordings that were judged wrong")
    options = parser.parse_args()
    planted, named = Counter[Cause](), Counter[Cause]()
    right = judged = good = alarms = short = 0
    by_form: dict[str, list[bool]] = {}
    took: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(options.count):
            form = {3: "rollout --bag", 5: "mujoco", 7: "stranger's bag"}.get(i % 10, "ours")
            try:
                made, seen = _recording(options.first + i, _causes(i, form), form, Path(folder, str(i)))
            except (UsageError, DivergedError) as error:
                print(f"{i}: {str(error)[:120]}", flush=True)
                continue
            if seen.following is not None and np.count_nonzero(seen.following) * seen.period < _SHORTEST:
                short += 1
                continue
            began = time.perf_counter()
            found = {each.cause for each in diagnose(seen, find_description(made.arm.settings())).found}
            took.append((time.perf_counter() - began) * 30.0 / (seen.time[-1] - seen.time[0]))
            truth = {each.cause for each in made.truth}
            judged, is_right = judged + 1, found == truth
            right += is_right
            by_form.setdefault(form, []).append(is_right)
            planted.update(truth)
            named.update(truth & found)
            good, alarms = good + (not truth), alarms + (not truth and bool(found))
            if not is_right and not options.quiet:
                faults = {each.cause.value: each.text for each in made.truth}
                print(f"{i}: {form}, {made.arm.label} {made.hardware}: {faults} -> {sorted(found)}", flush=True)
    table = {cause.value: f"{named[cause]} of {planted[cause]}" for cause in Cause}
    print(json.dumps(table, indent=1))
    print({form: f"{sum(each)} of {len(each)}" for form, each in by_form.items()})
    print(f"right: {right} of {judged} ({100.0 * right / max(judged, 1):.1f} %), {short} too short")
    print(f"false alarms: {alarms} of {good} good runs")
    print(f"30 s of data take {np.mean(took):.2f} s, at most {np.max(took):.2f} s")


def _causes(i: int, form: str) -> list[Cause]:
    """Faults of the i-th recording."""
    random = np.random.default_rng([i, 5])
    possible = [cause for cause in Cause if form != "rollout --bag" or cause not in _UNSEEN]
    if i % 3 == 0:
        return []
    if i % 3 == 1 or i % 2:
        return [possible[(i // 3 + i) % len(possible)]]
    while True:
        chosen = [Cause(name) for name in random.choice([each.value for each in possible], 2, replace=False)]
        if compatible(chosen):
            return chosen


def _recording(seed: int, causes: list[Cause], form: str, folder: Path) -> tuple[BlindArm, Observed]:
    """A blind arm, and what is seen of it."""
    folder.mkdir()
    made = blind_arm(seed, folder, causes=causes, duration=_DURATIONS[seed % 3])
    if form == "rollout --bag":
        run = rollout(made.experiment)
        write_rollout_bag(run, made.experiment.values["trajectory"], folder / "bag")
        return made, read_observed(folder / "bag")[0]
    if form == "ours":
        return made, observe(made.experiment)
    foreign = {"simulator": {"engine": "mujoco"}}
    seen = observe(make_experiment(made.experiment, overrides=foreign))
    if form == "stranger's bag":
        _write(folder / "bag", seen)
        seen = read_observed(folder / "bag")[0]
    return made, seen


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
