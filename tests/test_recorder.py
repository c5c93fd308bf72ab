"""The recorder loses nothing that is older than a second, reports what is missing, and outlives its disk."""

import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import yaml
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from support.testbed import Testbed

from pidtsm_experiments.bags.recorder_node import TOPICS
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.runs.runner import Process
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.middleware import RECEIVERS
from pidtsm_ros.qos import PUBLISHER
from pidtsm_ros.stamps import set_stamp

PUBLISHED = ("joint_states", "simulator/ground_truth")
"""At 1 kHz; the publishers of the other topics publish nothing."""
PERIOD = 1_000_000  # ns
KILLED = 20
AT_ONCE = 5
LATEST_KILL = 2.5  # s
PROMISE = 1_000_000_000  # ns; what is older than that is readable


class Loop:
    """Publishes what recorders subscribe to, as fast as a loop does."""

    def __init__(self, testbed: Testbed, namespace: str = "", published: Sequence[str] = PUBLISHED) -> None:
        self.testbed = testbed
        self.namespace = namespace
        self.sent: dict[str, list[int]] = {topic: [] for topic in published}
        self.out: dict[str, list[int]] = {topic: [] for topic in published}
        self._publishers = {
            topic: testbed.node.create_publisher(kind, f"{namespace}/{topic}", PUBLISHER)
            for topic, kind in TOPICS.items()
            if topic in published or published is PUBLISHED
        }
        self._message = JointState(name=["joint1", "joint2"], position=[0.0, 0.0], velocity=[0.0, 0.0])

    def start(self, bag: Path, *parameters: str) -> Process:
        """A recorder of this loop."""
        words = [word for parameter in (f"output:={bag}", *parameters) for word in ("-p", parameter)]
        if self.namespace:
            words += ["-r", f"__ns:={self.namespace}"]
        log = self.testbed.folder / f"{bag.name}.log"
        process = self.testbed.processes.start("recorder", words, self.testbed.environment, log)
        # There may be several; processes are known by their names.
        self.testbed.processes.running[bag.name] = self.testbed.processes.running.pop("recorder")
        return process

    def wait_for(self, recorders: int) -> None:
        """Wait until so many recorders have subscribed to every topic."""

        def all_listen() -> bool:
            return all(p.get_subscription_count() >= recorders for p in self._publishers.values())

        self.testbed.spin_until(all_listen, f"{recorders} recorders listen")

    def publish(self) -> None:
        """Publish one sample; `sent` gets its stamp, `out` the time when publishing was done.

        That may be later: a reader that is killed can block a publisher.
        """
        now = time.time_ns()
        set_stamp(self._message.header.stamp, now)
        for topic in self.sent:
            self._publishers[topic].publish(self._message)
            self.sent[topic].append(now)
            self.out[topic].append(time.time_ns())

    def run(self, seconds: float = 0.0) -> Iterator[float]:
        """Publish at 1 kHz, and yield the time since the start (s) after each sample; without end if `seconds` is 0."""
        began = time.monotonic_ns()
        due = began
        while not seconds or due - began < seconds * 1e9:
            self.publish()
            yield (time.monotonic_ns() - began) / 1e9
            due += PERIOD
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)


@pytest.fixture
def loop(testbed: Testbed) -> Loop:
    return Loop(testbed)


def recorded(bag: Path, namespace: str = "") -> dict[str, set[int]]:
    """Stamps in a bag, finished or not, by topic."""
    stamps: dict[str, set[int]] = defaultdict(set)
    with readable(bag) as rest:
        if not rest.files:
            return stamps  # Killed before anything was written.
        with AnyReader(rest.files) as reader:
            for connection, _, payload in reader.messages():
                stamps[connection.topic.removeprefix(namespace + "/")].add(serialized_nanoseconds(payload))
    return stamps


def test_an_interrupt_ends_it_although_the_system_goes_on(testbed: Testbed) -> None:
    loop = Loop(testbed)
    bag = testbed.folder / "bag"
    process = loop.start(bag)
    loop.wait_for(1)
    interrupted = False
    for elapsed in loop.run(30.0):
        if elapsed > 0.5 and not interrupted:
            process.interrupt()
            interrupted = True
        if process.process.poll() is not None:
            break
    assert process.process.poll() == 0
    assert (bag / "metadata.yaml").exists()


def test_killed_at_any_moment_leaves_all_that_is_older_than_a_second(testbed: Testbed) -> None:
    moments = random.Random(35)
    checked = 0
    for group in range(KILLED // AT_ONCE):
        bags = [testbed.folder / f"bag{group}{i}" for i in range(AT_ONCE)]
        loop = Loop(testbed, f"/group{group}")
        alive = {bag: loop.start(bag) for bag in bags}
        loop.wait_for(AT_ONCE)
        due = {bag: moments.uniform(0.1, LATEST_KILL) for bag in bags}
        killed: dict[Path, int] = {}
        for now in loop.run():
            for bag in [bag for bag in alive if now >= due[bag]]:
                alive.pop(bag).process.kill()
                killed[bag] = time.time_ns()
            if not alive:
                break
        for bag in bags:
            testbed.processes.running.pop(bag.name).process.wait()
            assert not (bag / "metadata.yaml").exists()
            got = recorded(bag, loop.namespace)
            for topic in PUBLISHED:
                left = zip(loop.sent[topic], loop.out[topic], strict=True)
                old = {stamp for stamp, out in left if out <= killed[bag] - PROMISE}
                checked += len(old)
                lacking = old - got[topic]
                assert not lacking, f"{bag.name} killed after {due[bag]:.2f} s lacks {len(lacking)} of {topic}"
    assert checked > 5000


def test_what_a_recorder_missed_while_it_was_stopped_it_gets_afterwards(testbed: Testbed, loop: Loop) -> None:
    bag = testbed.folder / "bag"
    process = loop.start(bag)
    loop.wait_for(1)
    acts = [(1.0, signal.SIGSTOP), (2.0, signal.SIGCONT)]
    for now in loop.run(3.0):
        if acts and now >= acts[0][0]:
            process.process.send_signal(acts.pop(0)[1])
    process.interrupt()
    assert process.wait() == 0
    got = recorded(bag)
    for topic in PUBLISHED:
        assert set(loop.sent[topic]) == got[topic]


@pytest.mark.parametrize("later", [False, True], ids=["alone", "then_commanded"])
def test_a_real_arm_without_ground_truth_is_recorded(testbed: Testbed, later: bool) -> None:
    loop = Loop(testbed, published=("joint_states",))
    bag = testbed.folder / "bag"
    process = loop.start(bag)
    loop.wait_for(1)
    commands: list[int] = []
    publisher = None
    for k, _ in enumerate(loop.run(1.0)):
        if later and k == 300:
            publisher = testbed.node.create_publisher(JointState, "joint_commands", PUBLISHER)
        if publisher and publisher.get_subscription_count():
            message = JointState(name=["joint1"], effort=[1.0])
            set_stamp(message.header.stamp, loop.sent["joint_states"][-1])
            publisher.publish(message)
            commands.append(loop.sent["joint_states"][-1])
    code, log, progress = end(process)
    assert code == 0
    sent = loop.sent["joint_states"]
    assert recorded(bag) == {"joint_states": set(sent)} | ({"joint_commands": set(commands)} if later else {})
    assert later == bool(commands)
    others = "/simulator/ground_truth, /controller/state, /joint_commands, /reference"
    assert f"recording without {others}, which nobody publishes" in log
    counted = (
        f"{len(commands)} of joint_commands, {len(sent)} of joint_states" if later else f"{len(sent)} of joint_states"
    )
    lacking = "simulator/ground_truth, controller/state" + (", reference" if later else ", joint_commands, reference")
    assert progress.splitlines()[-1] == f"recorded {len(sent)} samples: {counted}; nothing of {lacking}"
    assert f"received {counted}; nothing of {lacking}" in log


def test_threads_that_receive_go_before_other_work(testbed: Testbed) -> None:
    """Otherwise messages are missed on a busy machine, and the loop must send them again."""
    process = testbed.start("recorder", f"output:={testbed.folder / 'bag'}")
    testbed.spin_until((testbed.folder / "bag").exists, "a recorder")
    if "SCHED_FIFO is not permitted" in process.log.read_text():
        pytest.skip("needs the right to real-time scheduling")

    def first_in_first_out() -> bool:
        threads = Path(f"/proc/{process.process.pid}/task").iterdir()
        receivers = [thread for thread in threads if (thread / "comm").read_text().startswith(RECEIVERS)]
        return bool(receivers) and all(os.sched_getscheduler(int(t.name)) == os.SCHED_FIFO for t in receivers)

    testbed.spin_until(first_in_first_out, "threads that receive messages")


# Full disks.


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 1 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if not mount or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs the right to mount a small disk")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def fill(loop: Loop, process: Process) -> None:
    """Publish until the recorder logs that its bag has ended, and 0.5 s longer."""
    loop.wait_for(1)
    log = ""
    for _ in loop.run(30.0):
        if len(loop.sent[PUBLISHED[0]]) % 100 == 0:
            log = process.log.read_text()
        if "recording ended" in log:
            break
    assert "recording ended" in log, log
    for _ in loop.run(0.5):
        assert process.process.poll() is None


def end(process: Process) -> tuple[int, str, str]:
    """Interrupt a recorder; its exit code, log and progress."""
    process.interrupt()
    code = process.wait()
    assert process.process.stdout is not None
    return code, process.log.read_text(), process.process.stdout.read().decode()


def check_ended_early(loop: Loop, bag: Path, process: Process, reason: str) -> None:
    """The bag is whole up to some moment; the recorder kept receiving, and reports that."""
    code, log, progress = end(process)
    assert code == 1
    assert f"recording ended: {reason}" in log
    assert f"{bag} is incomplete: {reason}" in log
    assert "Traceback" not in log
    sent = loop.sent["simulator/ground_truth"]
    last = progress.splitlines()[-1]
    assert last.startswith(f"recorded {len(sent)} samples: {len(sent)} of simulator/ground_truth, ")
    assert last.endswith("; nothing of controller/state, joint_commands, reference")
    got = recorded(bag)["simulator/ground_truth"]
    assert 100 < len(got) < len(sent)
    assert got == set(sent[: len(got)])


def test_a_disk_that_gets_full_ends_the_bag_and_nothing_else(loop: Loop, small_disk: Path) -> None:
    process = loop.start(small_disk / "bag", "min_free_space:=500000")
    fill(loop, process)
    check_ended_early(loop, small_disk / "bag", process, f"{small_disk}/bag is on a disk with 0.")
    assert (small_disk / "bag" / "metadata.yaml").exists()


def test_a_disk_that_is_full_ends_the_bag_and_nothing_else(loop: Loop, small_disk: Path) -> None:
    process = loop.start(small_disk / "bag", "min_free_space:=0")
    fill(loop, process)
    check_ended_early(loop, small_disk / "bag", process, "cannot write: No space left on device")


def test_a_write_error_ends_the_bag_and_nothing_else(testbed: Testbed, loop: Loop) -> None:
    bag = testbed.folder / "bag"
    process = loop.start(bag)
    loop.wait_for(1)
    resource.prlimit(process.process.pid, resource.RLIMIT_FSIZE, (400_000, 400_000))
    fill(loop, process)
    check_ended_early(loop, bag, process, "cannot write: File too large")


def test_a_disk_without_space_is_refused(testbed: Testbed) -> None:
    process = testbed.start("recorder", f"output:={testbed.folder / 'bag'}", f"min_free_space:={2**60}")
    assert process.wait() == 1
    (line,) = process.log.read_text().splitlines()
    assert line.startswith(f"cannot record: {testbed.folder}/bag is on a disk with ")
    assert line.endswith("free some space, record elsewhere, or lower min_free_space")
    assert not (testbed.folder / "bag").exists()


# What is missing is reported, and a bag may have many files.


def test_lost_messages_are_counted(testbed: Testbed, loop: Loop) -> None:
    process = loop.start(testbed.folder / "bag")
    loop.wait_for(1)
    for _ in loop.run(0.2):
        pass
    testbed.spin_until(lambda: (testbed.folder / "bag" / "bag_0.mcap").stat().st_size > 10_000, "something is recorded")
    process.process.send_signal(signal.SIGSTOP)
    # More than the publishers keep for a reader that does not answer.
    for _ in range(PUBLISHER.depth + 10_000):
        loop.publish()
    process.process.send_signal(signal.SIGCONT)
    testbed.spin_until(lambda: "lost so far" in process.log.read_text(), "a warning of the recorder")
    code, log, _ = end(process)
    assert code == 0
    got = recorded(testbed.folder / "bag")
    for topic in PUBLISHED:
        lost = len(loop.sent[topic]) - len(got[topic])
        assert lost > 0
        assert f"{lost} of {topic}" in log.rpartition(": lost ")[2]


@pytest.mark.parametrize(
    ("limit", "killed"),
    [("max_bag_size:=100000", False), ("max_bag_size:=100000", True), ("max_bag_duration:=0.5", False)],
)
def test_a_long_recording_is_split(testbed: Testbed, loop: Loop, limit: str, killed: bool) -> None:
    bag = testbed.folder / "bag"
    process = loop.start(bag, limit)
    loop.wait_for(1)
    for _ in loop.run(2.0):
        pass
    if killed:
        testbed.spin_until((bag / "bag_2.mcap").exists, "a third file")
        process.process.kill()
        process.process.wait()
    else:
        assert end(process)[0] == 0
    files = sorted(file.name for file in bag.iterdir())
    assert files[:3] == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap"]
    got = recorded(bag)
    if killed:
        assert got["joint_states"] == set(loop.sent["joint_states"][: len(got["joint_states"])])
        return
    assert got == {topic: set(loop.sent[topic]) for topic in PUBLISHED}
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    parts = [file for file in files if file.endswith(".mcap")]
    assert about["relative_file_paths"] == [file["path"] for file in about["files"]] == parts
    assert (
        about["message_count"] == sum(file["message_count"] for file in about["files"]) == sum(map(len, got.values()))
    )
    counts = {t["topic_metadata"]["name"].lstrip("/"): t["message_count"] for t in about["topics_with_message_count"]}
    assert counts == {topic: len(got.get(topic, ())) for topic in (*TOPICS, "diagnostics", "simulator/push")}
    assert not [name for name in files if name not in (*parts, "metadata.yaml")]
