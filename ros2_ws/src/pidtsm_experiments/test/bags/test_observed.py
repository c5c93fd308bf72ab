"""What is seen of a loop in its bag is what another reader finds there."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.observed import read_observed
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag
from pidtsm_experiments.runs.runner import run


def of_rollout(experiment: Experiment, folder: Path) -> Path:
    """The bag of a rollout."""
    write_rollout_bag(rollout(experiment), experiment.values["trajectory"], folder / "bag")
    return folder / "bag"


def of_nodes(experiment: Experiment, folder: Path) -> Path:
    """The bag of our nodes."""
    return run(experiment, "lockstep", folder, lambda _: None)


@pytest.mark.parametrize("record", [of_rollout, of_nodes])
def test_when_a_controller_follows_and_why_it_stops_is_read_as_rosbags_decodes_it(
    record: Callable[[Experiment, Path], Path], tmp_path: Path
) -> None:
    slow = {"controller": {"limits.velocity": [0.05, 0.05]}}
    bag = record(make_experiment("case1", duration=1.0, overrides=slow), tmp_path)
    observed, _ = read_observed(bag)
    with AnyReader([bag], default_typestore=typestore()) as reader:
        states = [each for each in reader.connections if each.topic.endswith("controller/state")]
        decoded: list[Any] = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages(states)]
    assert observed.following is not None
    assert np.array_equal(observed.following, [message.mode == message.FOLLOWING for message in decoded])
    assert 0 < np.count_nonzero(observed.following) < observed.time.size
    faults = {message.fault for message in decoded} - {0}
    assert faults == {decoded[0].VELOCITY_LIMIT}
    assert observed.stopped == "velocity limit"
