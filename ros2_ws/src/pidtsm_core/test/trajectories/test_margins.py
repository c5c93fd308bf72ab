"""What is planned as fast as possible does not stop the arm, and what would stop it is not accepted."""

from pathlib import Path

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Status
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.margins import PLANNED_SHARE
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.timing import retime

SLOW = 0.8
"""A velocity limit that every joint reaches, rad/s or m/s."""


@pytest.fixture(scope="module")
def slow(arm: Arm) -> MotionLimits:
    return motion_limits({**arm.settings, "limits.velocity": SLOW})


def ways(limits: MotionLimits) -> tuple[Array, Array]:
    """From one side of the range to the other, of all joints."""
    low, high = np.maximum(limits.lower, -1.0), np.minimum(limits.upper, 1.0)
    low, high = np.minimum(low, high - 0.5), np.maximum(high, low + 0.5)
    middle = np.clip(0.5 * (low + high), limits.lower + 0.3, limits.upper - 0.3)
    return middle - 0.25, middle + 0.25


def table(motion: PiecewiseMotion, names: list[str], file: Path) -> float:
    """Write a motion as a file of the reference ``csv``; returns its duration, s."""
    times, state = np.arange(0.0, motion.end + 0.2, 1e-3), np.zeros((3, len(names)))
    rows = []
    for time in times:
        motion.evaluate(time, state)
        rows.append([time, *state.ravel()])
    columns = ", ".join(f"{quantity}_{name}" for quantity in ("q", "dq", "ddq") for name in names)
    np.savetxt(file, rows, delimiter=",", header=f"time, {columns}", comments="")
    return float(times[-1])


@pytest.mark.parametrize("bits", [0, 14])
def test_the_fastest_motion_does_not_stop_the_arm(arm: Arm, slow: MotionLimits, bits: int, tmp_path: Path) -> None:
    start, end = ways(slow)
    file = tmp_path / "motion.csv"
    duration = table(retime(np.array([start, end]), slow), arm.names, file)
    simulator = {**arm.settings, "initial_position": start.tolist(), "encoder.bits": bits, "disturbance.name": "none"}
    controller = {**arm.settings, "limits.velocity": SLOW}
    reference = {"reference.name": "csv", "reference.file": str(file)}
    nodes = {"simulator": simulator, "controller": controller, "trajectory": reference}
    run = rollout(make_experiment(Experiment("move", "", duration, nodes), params=["practical"]))
    assert (run.status[:, Status.FAULT] == Fault.NO_FAULT).all(), run.metrics()["faults"]
    fastest = np.abs(run.estimated_velocity).max() / SLOW
    assert 0.9 < fastest < 0.98


def test_a_motion_faster_than_planned_is_not_accepted(arm: Arm, slow: MotionLimits) -> None:
    motion = retime(np.array(ways(slow)), slow)
    check(motion, slow)
    with pytest.raises(TrajectoryError, match=rf"at most {PLANNED_SHARE * SLOW:g} \(95 % of limits.velocity, beyond"):
        check(motion.stretched(0.999), slow)
