"""Whether an arm follows a trajectory is judged by tolerances of the way, of the goal, and of the time."""

import math

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.tracking import REACHED, VIOLATED, Code, Outcome, Tolerances, Tracking

REACHED_IT = Outcome(Code.SUCCESSFUL, REACHED)
JOINTS = ("shoulder", "elbow")
ANY = np.full((2, 2), math.inf)
MS = 1_000_000
START, END = 5_000 * MS, 6_000 * MS


def tracking(path: Array = ANY, goal: Array = ANY, goal_time: float = math.inf, continuous: bool = False) -> Tracking:
    return Tracking(JOINTS, np.array([False, continuous]), Tolerances(path, goal, goal_time), START, END)


def follow(tracked: Tracking, errors: Array, begin: int = START) -> tuple[int, Outcome] | None:
    """The first outcome and its time, for errors 1 ms apart, shape (samples, joints); the arm should be at 1, 2 rad."""
    desired = np.array([[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]])
    for k, error in enumerate(errors):
        outcome = tracked.judge(begin + k * MS, desired, desired[0] + error)
        if outcome:
            return k, outcome
    return None


def ramp(samples: int, first: float, last: float) -> Array:
    """Errors of the elbow."""
    return np.column_stack([np.zeros(samples), np.linspace(first, last, samples)])


def test_the_way_is_judged_before_the_end_only() -> None:
    path = np.array([[0.1, 0.05], [math.inf, math.inf]])
    found = follow(tracking(path), ramp(101, 0.0, 0.1))
    assert found is not None
    sample, outcome = found
    assert (sample, outcome.code) == (51, Code.PATH_TOLERANCE_VIOLATED)
    text = "elbow: position error 0.051 exceeds the tolerance 0.05, 0.051 s after the start"
    assert outcome.text.startswith(f"{VIOLATED}: {text}; ")
    assert follow(tracking(path), ramp(10, 0.0, 0.2), END - MS) == (1, REACHED_IT)


def test_the_first_sample_is_one_of_the_way_even_after_the_end() -> None:
    """So does joint_trajectory_controller with a goal that takes no time and is elsewhere."""
    path = np.array([[0.1, 0.05], [math.inf, math.inf]])
    found = follow(tracking(path), ramp(10, 0.2, 0.2), END)
    assert found is not None
    assert (found[0], found[1].code) == (0, Code.PATH_TOLERANCE_VIOLATED)


def test_no_tolerance_accepts_any_error() -> None:
    assert follow(tracking(), ramp(500, -3.0, 3.0)) is None


def test_the_velocity_error_is_that_of_the_position_error_soon() -> None:
    tracked = tracking()
    assert follow(tracked, ramp(501, 0.0, 0.5)) is None
    np.testing.assert_allclose(tracked.error[1], [0.0, 1.0], rtol=1e-3, atol=1e-12)


def test_the_velocity_error_has_a_tolerance_too() -> None:
    found = follow(tracking(np.array([[math.inf, math.inf], [0.5, 0.5]])), ramp(501, 0.0, 0.5))
    assert found is not None
    assert found[1].code == Code.PATH_TOLERANCE_VIOLATED
    assert "elbow: velocity error 0.5" in found[1].text


def test_success_needs_position_and_velocity() -> None:
    goal = np.array([[0.03, 0.03], [0.01, 0.01]])
    found = follow(tracking(goal=goal), np.vstack([ramp(100, 0.1, 0.0), ramp(200, 0.0, 0.0)]), END)
    assert found is not None
    assert found[1] == REACHED_IT
    assert 100 < found[0] < 300, "within 0.03 rad, but not at rest at first"


@pytest.mark.parametrize("goal_time", [0.0, 0.25])
def test_a_goal_that_is_not_reached_in_time_is_an_error(goal_time: float) -> None:
    goal = np.array([[0.03, 0.03], [math.inf, math.inf]])
    found = follow(tracking(goal=goal, goal_time=goal_time), ramp(1000, 0.04, 0.04), END)
    assert found is not None
    sample, outcome = found
    assert (sample, outcome.code) == (round(goal_time * 1000) + 1, Code.GOAL_TOLERANCE_VIOLATED)
    assert outcome.text.startswith(f"Aborted due to goal_time_tolerance exceeding by {goal_time + 1e-3:f} seconds: ")
    assert "elbow: position error 0.04 exceeds the tolerance 0.03 at the goal" in outcome.text
    assert f"goal_time_tolerance ({goal_time:g} s)" in outcome.text


def test_without_a_goal_time_the_arm_may_take_any() -> None:
    goal = np.array([[0.03, 0.03], [math.inf, math.inf]])
    errors = np.vstack([ramp(3000, 0.04, 0.04), ramp(1, 0.0, 0.0)])
    assert follow(tracking(goal=goal), errors, END) == (3000, REACHED_IT)


def test_a_full_turn_is_no_error_of_a_joint_that_turns_without_end() -> None:
    path = np.array([[0.05, 0.05], [math.inf, math.inf]])
    turned = ramp(10, -math.tau, -math.tau)
    assert follow(tracking(path, continuous=True), turned) is None
    assert follow(tracking(path), turned) is not None
