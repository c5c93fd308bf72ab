"""What is seen of a loop in its bag is what another reader finds there."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.observed import read_observed
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag


def test_when_a_controller_follows_and_why_it_stops_is_read_as_rosbags_decodes_it(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    write_rollout_bag(
        rollout(duration=1.0, controller={"limits.velocity": [0.05, 0.05]}),
        make_experiment("case1").values["trajectory"],
        bag,
    )
    observed, used = read_observed(bag)
    assert used == "simulator/ground_truth, joint_commands, reference"
    with AnyReader([bag], default_typestore=typestore()) as reader:
        states = [each for each in reader.connections if each.topic.endswith("controller/state")]
        decoded: list[Any] = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages(states)]
    assert observed.following is not None
    assert np.array_equal(observed.following, [message.mode == message.FOLLOWING for message in decoded])
    assert 0 < np.count_nonzero(observed.following) < observed.time.size
    faults = {message.fault for message in decoded} - {0}
    assert faults == {decoded[0].VELOCITY_LIMIT}
    assert observed.stopped == "velocity limit"
