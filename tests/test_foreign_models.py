"""Arms in MJCF that others wrote, with torques as inputs, track with the gains that follow from their description."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Status

found = find_spec("gymnasium")
assert found is not None
assert found.origin is not None
MODELS = Path(found.origin).parent / "envs" / "mujoco" / "assets"
ABOVE_THE_TABLE = (-0.3, -0.2, 0.1, -0.8, 0.0, -0.5, 0.0)
"""Where the arm of pusher_v5.xml meets neither the table nor the object, rad."""


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
@pytest.mark.parametrize(("model", "joints", "start"), [("pusher_v5", 7, ABOVE_THE_TABLE), ("reacher", 2, (0.0, 0.0))])
def test_an_arm_of_gymnasium_tracks(model: str, joints: int, start: tuple[float, ...], engine: str) -> None:
    file = str(MODELS / f"{model}.xml")
    robot = find_robot({"robot.description": file})
    # The objects beside the arm, which no motor moves, do not belong to it.
    assert len(robot.joints) == joints
    assert np.isfinite(robot.effort_limit).all()
    simulator = {"engine": engine, "initial_position": start}
    run = rollout(
        None, "piddtsm", "practical", file, duration=8.0, simulator=simulator, trajectory={"reference.offset": start}
    )
    assert set(run.status[:, Status.FAULT]) == {Fault.NO_FAULT}
    assert np.ptp(run.position, axis=0).min() > 0.25
    assert np.abs(run.error[run.time > 4.0]).max() < 2e-4


def test_it_may_touch_what_is_in_the_file() -> None:
    """The pusher meets the table, and holds on."""
    run = rollout(
        None, "piddtsm", "practical", str(MODELS / "pusher_v5.xml"), duration=6.0, simulator={"engine": "mujoco"}
    )
    assert 5e-3 < np.abs(run.error[run.time > 2.0]).max() < 0.1
    assert run.status[-1, Status.FAULT] == Fault.NO_FAULT
