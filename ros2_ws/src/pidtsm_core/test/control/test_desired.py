"""The motion that the law follows: the reference, a held position, and the way between them."""

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import Condition, Count
from pidtsm_core.references import extrapolate
from pidtsm_core.signals import Adaptation, Mode, Status

MS = 1_000_000
START = 1_000_000_000
PATIENT = {"watchdog.state_stop": 10.0, "watchdog.reference": 0.1}
RATES = [10.0, 3.0, 1.0]
"""Limits of the rate of the torque, as shares of the limit of the torque per second."""


class Follower:
    """A controller whose arm is always at its desired position, and a reference with constant velocity.

    Attributes:
        reference_stamp: stamp of the newest reference, ns; -1: none.
    """

    def __init__(self, arm: Arm, rate: float = 0.0, **changes: object) -> None:
        """Args: rate: a share of the limit per second."""
        limits = {"limits.effort_rate": (rate * arm.limits).tolist()}
        self.controller = arm.controller(**{**PATIENT, **limits, **changes})
        self.start = np.array(arm.start)
        self.controller.position[:] = arm.start
        self.reference_stamp = -1
        self.sample = 0

    def reference(self, stamp: int) -> Array:
        motion, later = np.zeros((2, 3, self.start.size))
        motion[0] = self.start + np.resize([0.4, -0.4], self.start.size)
        motion[1] = np.resize([0.4, 0.2], self.start.size)
        extrapolate(motion, (stamp - START) / 1e9, later)
        return later

    def refer(self, age: int = 0) -> None:
        """Give the controller a reference that will be `age` (ns) old at the next sample."""
        self.reference_stamp = START + self.sample * MS - age
        self.controller.reference[:] = self.reference(self.reference_stamp)

    def step(self) -> Array:
        """Return the desired motion of the next sample, shape (3, joints)."""
        self.controller.step(START + self.sample * MS, self.reference_stamp)
        self.sample += 1
        desired = self.controller.state.desired.copy()
        self.controller.position[:] = desired[0]
        return desired

    @property
    def mode(self) -> int:
        return self.controller.status[Status.MODE]


def test_without_a_reference_the_arm_is_held_where_it_starts(arm: Arm) -> None:
    follower = Follower(arm)
    for _ in range(5):
        np.testing.assert_array_equal(follower.step(), [arm.start, [0.0] * arm.joints, [0.0] * arm.joints])
        assert follower.mode == Mode.HOLDING


@pytest.mark.parametrize("sign", [1, -1], ids=["old", "ahead"])
def test_a_reference_is_followed_up_to_the_largest_age_and_again_at_half_of_it(arm: Arm, sign: int) -> None:
    follower = Follower(arm)
    for age, mode in (
        (0, Mode.FOLLOWING),
        (100, Mode.FOLLOWING),
        (101, Mode.HOLDING),
        (99, Mode.HOLDING),
        (51, Mode.HOLDING),
        (50, Mode.FOLLOWING),
        (100, Mode.FOLLOWING),
    ):
        follower.refer(sign * age * MS)
        follower.step()
        assert follower.mode == mode, age


@pytest.mark.parametrize("age", [0, 7 * MS, -7 * MS])
def test_the_reference_is_extrapolated_to_the_sample(arm: Arm, age: int) -> None:
    follower = Follower(arm, activation__blend=0.0)
    for _ in range(3):
        follower.refer(age)
        expected = follower.reference(START + follower.sample * MS)
        np.testing.assert_allclose(follower.step(), expected, rtol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 3.0])
@pytest.mark.parametrize("held", [0, 200])
def test_the_way_begins_with_the_present_motion_and_ends_on_the_reference(arm: Arm, held: int, rate: float) -> None:
    """From the start, and after a position was held."""
    follower = Follower(arm, rate, activation__blend=0.3)
    motion = [follower.step() for _ in range(held)]
    ways = []
    for _ in range(3000):
        follower.refer()
        motion.append(follower.step())
        ways.append(follower.controller.state.approach_duration[0])
    path = np.array(motion)
    if not held:
        np.testing.assert_allclose(path[0], [arm.start, [0.0] * arm.joints, [0.0] * arm.joints], atol=1e-12)
    # The motion changes only as its derivatives require: it makes no step.
    for derivative in range(2):
        steps = np.diff(path[:, derivative], axis=0)
        mean = 0.5 * (path[1:, derivative + 1] + path[:-1, derivative + 1])
        np.testing.assert_allclose(steps, 0.001 * mean, atol=2e-4 if derivative else 1e-6)
    took = np.count_nonzero(ways)
    assert took == 300 if rate == 0.0 else 300 < took < 2500
    np.testing.assert_array_equal(path[-1], follower.reference(START + (follower.sample - 1) * MS))


@pytest.mark.parametrize("rate", RATES)
def test_with_a_rate_limit_the_way_is_long_enough_for_the_torque_to_follow(arm: Arm, rate: float) -> None:
    follower = Follower(arm, rate, activation__blend=0.05)
    controller = follower.controller
    efforts = []
    for _ in range(2000):
        follower.refer()
        efforts.append(arm.effort(*follower.step()))
    # The rest of the rate is for the law, and enough for it, except at single samples.
    assert (np.abs(np.diff(efforts, axis=0)) < 0.66 * rate * arm.limits * 0.001).all()
    assert controller.state.counts[Count.AT_RATE_LIMIT] <= 2


def test_the_adaptation_is_approaching_while_there_is_a_way_to_a_reference(arm: Arm) -> None:
    follower, seen = Follower(arm, activation__blend=0.1), []
    for sample in range(600):
        if not 200 <= sample < 400:
            follower.refer()
        follower.step()
        seen.append(follower.controller.state.conditions[Condition.ADAPTATION])
    approaching = [*range(100), *range(400, 500)]
    assert [k for k, adaptation in enumerate(seen) if adaptation == Adaptation.APPROACHING] == approaching
    assert set(seen) == {Adaptation.NORMAL, Adaptation.APPROACHING}
