"""Time and memory of `analyze` for recordings of different lengths, compared with only reading the bag with rosbags."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal, Status
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.recorder_node import FLUSH_PERIOD, MAX_BAG_DURATION, MAX_BAG_SIZE
from pidtsm_experiments.bags.writer import BagWriter
from pidtsm_experiments.commands.bench import Row

_ANALYZE = "from pidtsm_experiments.bags.analysis import analyze; analyze(bag)"
_READ = """
from rosbags.highlevel import AnyReader
from pidtsm_experiments.bags.message_types import typestore
with AnyReader([bag], default_typestore=typestore()) as reader:
    for connection, stamp, payload in reader.messages():
        pass
"""
_MEASURE = """
import json, sys, time
from pathlib import Path
import pidtsm_core.recording.summary
bag = Path(sys.argv[1])
begin = time.perf_counter()
{work}
spent = time.perf_counter() - begin
# Not ru_maxrss, which starts at the value of the parent process.
peak = Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]
print(json.dumps([spent, int(peak) / 1e6]))
"""

TAKES = 240.0  # s


def run(quick: bool) -> Iterator[Row]:
    """30 s, 5 min and 1 h of 1 kHz data; one hour needs 4 GB in the folder for temporary files (TMPDIR)."""
    for seconds in (2,) if quick else (30, 300, 3600):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder, "bag")
            write_bag(bag, seconds)
            read, _ = _measured(_READ, bag)
            spent, memory = _measured(_ANALYZE, bag)
        name = f"analyze {seconds} s of 1 kHz data"
        yield Row(name, spent, "s", "reading it with rosbags", read, spent / read, "<= 2")
        yield Row(f"{name}, peak memory", memory, "GB", "bound", 1.0, memory, "<= 1")


def _measured(work: str, bag: Path) -> tuple[float, float]:
    """Run the work in a new process; returns its time in s and its peak memory in GB."""
    command = [sys.executable, "-c", _MEASURE.format(work=work), str(bag)]
    seconds, memory = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return seconds, memory


def write_bag(path: Path, seconds: int) -> None:
    """Write a bag like the recorder's; its samples repeat a rollout of at most 30 s.

    Only the stamps of serialized messages are overwritten, since one hour has 18 million messages.
    """
    run = rollout(duration=min(seconds, 30))
    store, names, nothing = typestore(), list(run.joints), np.empty(0)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    joint_state = types["sensor_msgs/msg/JointState"]
    reference = types["pidtsm_msgs/msg/JointReference"]
    state = types["pidtsm_msgs/msg/ControllerState"]
    # Numbers of the loop, after header, name, signals and status.
    others = len(store.get_msgdef("pidtsm_msgs/msg/ControllerState").fields) - len(Signal) - len(Status) - 2

    def messages(k: int) -> dict[str, Any]:
        return {
            "joint_states": joint_state(header, names, run.position[k], run.velocity[k], nothing),
            "reference": reference(header, names, *run.reference[k], np.zeros(len(names))),
            "joint_commands": joint_state(header, names, nothing, nothing, run.effort[k]),
            "controller/state": state(header, names, *run.signals[k], *run.status[k].tolist(), *[2e-5] * others),
            "simulator/ground_truth": joint_state(header, names, run.position[k], run.velocity[k], run.effort[k]),
        }

    kinds = {topic: message.__msgtype__ for topic, message in messages(0).items()}
    payloads = [
        [bytearray(store.serialize_cdr(message, kinds[topic])) for topic, message in messages(k).items()]
        for k in range(run.time.size)
    ]
    writer = BagWriter(path, "", MAX_BAG_SIZE, MAX_BAG_DURATION)
    topics = [writer.add_topic(f"/{topic}", kind) for topic, kind in kinds.items()]
    flush_period = round(FLUSH_PERIOD * 1e9)
    for k in range(seconds * 1000):
        stamp = k * 1_000_000
        encoded = np.array(divmod(stamp, 1_000_000_000), dtype="<u4").tobytes()
        for topic, payload in zip(topics, payloads[k % len(payloads)], strict=True):
            payload[4:12] = encoded
            writer.write(topic, stamp, bytes(payload))
        if stamp % flush_period == 0:
            writer.flush()
    writer.close()
