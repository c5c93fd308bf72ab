"""Two systems share a graph, each in its namespace, and neither notices the other."""

from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.runs.runner import Process, Processes, bag_metadata, node_parameters

DURATION = 1.5


def start(name: str, namespace: str, law: str, testbed: Testbed, processes: Processes) -> tuple[Process, Path]:
    """The three nodes in one process, and a recorder: the process that ends by itself, and the bag."""
    folder = testbed.folder / name
    folder.mkdir()
    experiment = make_experiment("case1", law, DURATION)
    arguments = ["-r", f"__ns:={namespace}"]
    for node, values in node_parameters(experiment, "lockstep").items():
        file = folder / f"{node}.yaml"
        file.write_text(ros_parameters(f"{namespace}/{node}", values), encoding="utf-8")
        arguments += ["--params-file", str(file)]
    loop = processes.start("composed", arguments, testbed.environment, folder / "composed.log")
    bag = folder / "bag"
    recording = [*arguments[:2], "-p", f"output:={bag}", "-p", f"metadata:='{bag_metadata(experiment, 'lockstep')}'"]
    processes.start("recorder", recording, testbed.environment, folder / "recorder.log")
    return loop, bag


def ended(process: Process) -> bool:
    return process.process.poll() is not None


def test_two_systems_on_one_graph_track_undisturbed(testbed: Testbed) -> None:
    systems = {"left": "piddtsm", "right": "computed_torque"}
    with ExitStack() as stack:
        started = {
            name: start(name, f"/{name}", law, testbed, stack.enter_context(Processes()))
            for name, law in systems.items()
        }
        for loop, _ in started.values():
            testbed.spin_until(partial(ended, loop), "the end of the run")
    for name, law in systems.items():
        loop, bag = started[name]
        assert loop.process.returncode == 0, loop.tail()
        recording = read_recording(bag)
        experiment = make_experiment("case1", law, DURATION)
        alone = rollout(experiment, duration=DURATION)
        np.testing.assert_array_equal(recording.position, alone.position)
        np.testing.assert_array_equal(recording.effort, alone.effort)
        assert recording.metrics()["law"] == law
        assert np.abs(recording.position[-1] - recording.reference[-1, 0]).max() < 0.05
