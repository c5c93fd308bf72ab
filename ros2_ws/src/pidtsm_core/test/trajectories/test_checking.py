"""Which trajectories an arm can follow."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import CRANE, PANDA, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import interpolate
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.margins import PLANNED_SHARE
from pidtsm_core.trajectories.motion import PiecewiseMotion


def move(start: Array, end: Array, duration: float = 4.0) -> PiecewiseMotion:
    """From rest to rest."""
    state = np.zeros((3, start.size))
    state[0] = start
    return interpolate(np.array([1.0, 1.0 + duration]), end[None, None], state)


def changed(arm: Arm, joint: int, by: float) -> tuple[Array, Array]:
    """The start of an arm, and another position of one joint."""
    start = np.array(arm.start)
    end = start.copy()
    end[joint] += by
    return start, end


def test_a_slow_motion_is_accepted_and_a_fast_one_is_not(arm: Arm, limits: MotionLimits) -> None:
    for joint in range(arm.joints):
        start, end = changed(arm, joint, 0.2)
        check(move(start, end), limits)
        with pytest.raises(TrajectoryError, match=f"^{arm.names[joint]}: the (velocity|torque|force) would be"):
            check(move(start, end, 0.05), limits)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"limits.min_position": -1.0, "limits.max_position": 0.9}, "position would be 1 m at 5.000 s; -1 to 0.9 is"),
        ({"limits.velocity": 0.3}, r"velocity would be 0.328125 m/s at 3.000 s; at most 0.285 \(95 % of .+\) is"),
        ({"limits.acceleration": 0.2}, r"acceleration would be -?0.252591 m/s\^2 at (1.845|4.155) s; at most 0.2 is"),
        ({"limits.effort": 118.0}, r"force would be 120.+ N at 1.8\d+ s; at most 118 is"),
    ],
)
def test_it_names_joint_amount_limit_and_time(settings: dict[str, float], reason: str) -> None:
    far = {"limits.min_position": [-9.0] * 3, "limits.max_position": [9.0] * 3, "limits.velocity": [9.0] * 3}
    own = {name: [value, *([99.0] * 2 if value > 0 else [-99.0] * 2)] for name, value in settings.items()}
    limits = motion_limits({**CRANE.settings, **far, **own})
    start, end = changed(CRANE, 0, 0.7)
    with pytest.raises(TrajectoryError, match=f"^lift: the {reason} allowed$"):
        check(move(start, end), limits)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 20), fields=st.integers(1, 3))
def test_extrema_are_exact(seed: int, count: int, fields: int) -> None:
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 1.0, count))])
    motion = interpolate(times, random.uniform(-1.0, 1.0, (count, fields, 2)), random.uniform(-0.5, 0.5, (3, 2)))
    state, largest = np.empty((3, 2)), np.zeros((2, 3, 2))
    for k, duration in enumerate(np.diff(times)):
        for share in np.linspace(0.0, 1.0 - 1e-12, 500):
            motion.evaluate(times[k] + share * duration, state)
            largest = np.maximum(largest, [state, -state])
    names = [{"joints": ["a", "b"]}]
    for factor in (0.999, 1.001):
        low, high = (factor * value for value in (-largest[1, 0] - 1e-4, largest[0, 0] + 1e-4))
        positions = motion_limits({**names[0], "limits.min_position": low, "limits.max_position": high})
        speed = factor * largest[:, 1].max(axis=0) / PLANNED_SHARE
        velocities = motion_limits({**names[0], "limits.velocity": speed})
        for limits, quantity in ((positions, "position"), (velocities, "velocity")):
            if factor > 1.0:
                check(motion, limits)
            elif largest[:, 0].min() > 0.2:
                with pytest.raises(TrajectoryError, match=quantity):
                    check(motion, limits)


def test_an_arm_outside_its_limits_may_move_back_but_not_farther_away() -> None:
    limits = motion_limits(PANDA.settings)
    start = np.array(PANDA.start)
    start[3] = limits.upper[3] + 0.2
    inside, farther, back_out = start.copy(), start.copy(), start.copy()
    inside[3], farther[3], back_out[3] = limits.upper[3] - 0.5, start[3] + 0.1, limits.upper[3] + 0.1
    check(move(start, inside), limits)
    check(move(start, start), limits)
    with pytest.raises(TrajectoryError, match="panda_joint4: the position"):
        check(move(start, farther), limits)
    state = np.zeros((3, 7))
    state[0] = start
    there_and_back = interpolate(np.array([0.0, 4.0, 8.0]), np.array([[inside], [back_out]]), state)
    with pytest.raises(TrajectoryError, match="panda_joint4: the position"):
        check(there_and_back, limits)


def test_efforts_are_those_of_the_model_in_any_order_of_the_joints() -> None:
    order = [1, 0]
    limits = motion_limits({"robot.description": "two_link", "joints": ["joint2", "joint1"]})
    start, end = np.array([0.3, 0.2]), np.array([1.4, 1.0])
    expected = motion_limits({"robot.description": "two_link"})
    for one, other in ((move(start, end, 0.6), move(start[order], end[order], 0.6)),):
        messages = []
        for motion, of in ((one, expected), (other, limits)):
            with pytest.raises(TrajectoryError) as caught:
                check(motion, of)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


def test_without_limits_everything_is_accepted(unlimited: MotionLimits) -> None:
    check(move(np.zeros(2), np.full(2, 1e3), 1e-3), unlimited)
