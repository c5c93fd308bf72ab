"""A run commands no other arm, not even in a domain that another system uses, and nobody on the network reaches it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support.rig import Watch
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs import runner
from pidtsm_experiments.runs.domain import domains_in_use
from pidtsm_ros.middleware import on_this_machine
from pidtsm_ros.stamps import nanoseconds

LOOP = ("simulator", "controller", "trajectory")
YEAR_2001 = 10**18
"""ns; in lockstep stamps begin at 0."""


def udp_sockets(process: int) -> set[tuple[str, int]]:
    """Address and port of each UDP socket of a process."""
    links = [str(link.readlink()) for link in Path(f"/proc/{process}/fd").iterdir() if link.is_symlink()]
    inodes = {link.removeprefix("socket:[").rstrip("]") for link in links if link.startswith("socket:[")}
    found = set()
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        words = line.split()
        if words[9] in inodes:
            address, _, port = words[1].partition(":")
            found.add((".".join(str(byte) for byte in reversed(bytes.fromhex(address))), int(port, 16)))
    assert not any(line.split()[9] in inodes for line in Path("/proc/net/udp6").read_text().splitlines()[1:]), (
        "sockets of IPv6"
    )
    return found


@pytest.mark.parametrize("bound", [False, True], ids=["as started by hand", "as in a run"])
def test_nodes_that_stay_on_this_machine_take_their_domain(testbed: Testbed, bound: bool) -> None:
    testbed.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    testbed.close()  # The test's own participant would be seen, too.
    domain = int(testbed.environment["ROS_DOMAIN_ID"])
    assert domain not in domains_in_use()
    if bound:
        testbed.environment = on_this_machine(testbed.environment)
    process = testbed.start("simulator")
    while domain not in domains_in_use():
        assert process.process.poll() is None, process.tail()


def test_every_socket_of_a_run_is_bound_to_loopback(testbed: Testbed) -> None:
    """And its nodes find each other, and the test's node, which listens everywhere."""
    given = dict(testbed.environment)
    processes = []
    for name in (*LOOP, "recorder"):
        testbed.environment = on_this_machine(given, "fastdds_recorder.xml" if name == "recorder" else "fastdds.xml")
        processes.append(testbed.start(name, *([f"output:={testbed.folder / 'bag'}"] if name == "recorder" else [])))
    watch = Watch(testbed.node, {"joint_commands": JointState})
    testbed.spin_until(lambda: watch.heard["joint_commands"], "commands")
    testbed.spin_until(lambda: testbed.node.count_subscribers("joint_states") == 3, "the recorder")
    for process in processes:
        sockets = udp_sockets(process.process.pid)
        assert len(sockets) >= 3, "for discovery, for messages, to send"
        assert {address for address, _ in sockets} == {"127.0.0.1"}, process.name


@pytest.mark.parametrize("words", [[], ["--composed"]], ids=["processes", "composed"])
def test_a_run_in_the_domain_of_another_system_leaves_it_alone(
    testbed: Testbed,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
) -> None:
    domain = testbed.environment["ROS_DOMAIN_ID"]

    @contextmanager
    def the_same() -> Iterator[int]:
        yield int(domain)

    monkeypatch.setattr(runner, "own_domain", the_same)
    testbed.start("simulator", "rate:=100", "realtime.priority:=0")  # The run must get its share of a busy machine.
    testbed.start("controller", "realtime.priority:=0")
    testbed.start("trajectory")
    watch = Watch(testbed.listener(), {"joint_commands": JointState, "joint_states": JointState})

    def commanded() -> bool:
        watch.take()
        return len(watch.heard["joint_commands"]) > 0

    testbed.spin_until(commanded, "the other system's commands")
    out = tmp_path / "out"
    assert main(["run", "--duration", "0.2", "--out", str(out), *words]) == 0
    heard = len(watch.heard["joint_commands"])
    testbed.spin_until(lambda: commanded() and len(watch.heard["joint_commands"]) > heard, "more of them")

    first = capsys.readouterr().err.splitlines()[0]
    place = re.search(rf"ROS_DOMAIN_ID={domain}, namespace (/run_[0-9a-f]{{8}})$", first)
    assert place, first
    assert (out / "log" / "place.txt").read_text().splitlines() == [place[0]]

    for topic in watch.heard:
        assert testbed.node.count_publishers(topic) == 1
        assert all(nanoseconds(message.header.stamp) > YEAR_2001 for message in watch.messages(topic)), topic
    recording = read_recording(out / "bag")
    np.testing.assert_array_equal(recording.effort, rollout(make_experiment("case1"), duration=0.2).effort)
    assert recording.rejected == dict.fromkeys(LOOP, 0), "others share /diagnostics"


def test_a_bag_of_a_run_has_plain_names_and_one_by_hand_has_full_ones(testbed: Testbed, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    names = []
    for parameters in ([], ["plain_names:=true"]):
        bag = tmp_path / str(len(parameters))
        words = [word for p in (f"output:={bag}", *parameters) for word in ("-p", p)]
        recorder = testbed.processes.start(
            "recorder", [*words, "-r", "__ns:=/left/arm"], testbed.environment, tmp_path / f"{bag.name}.log"
        )
        publisher = testbed.node.create_publisher(JointState, "/left/arm/reference", 10)
        testbed.spin_until(lambda: testbed.node.count_subscribers("/left/arm/joint_commands") == 1, "the recorder")
        recorder.interrupt()
        assert recorder.wait() == 0, recorder.tail()
        testbed.node.destroy_publisher(publisher)
        with AnyReader([bag], default_typestore=typestore()) as reader:
            names.append({connection.topic for connection in reader.connections})
    plain = {"/joint_commands", "/reference", "/controller/state", "/simulator/ground_truth", "/simulator/push"}
    assert names == [{f"/left/arm{name}" for name in plain} | {"/diagnostics"}, plain | {"/diagnostics"}]
