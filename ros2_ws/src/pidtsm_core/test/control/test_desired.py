"""The motion that the law follows: the reference, a held position, and the way between them."""

import numpy as np
import pytest

from pidtsm_core.control import Clock, Controller, controller_schema
from pidtsm_core.parameters import Array, resolve
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Adaptation, Mode, Status

MS = 1_000_000
START = 1_000_000_000
PATIENT = {"watchdog.state_stop": 10.0, "watchdog.reference": 0.1}


class Follower:
    """A controller whose arm is always at its desired position, and a reference with constant velocity.

    Attributes:
        reference_stamp: stamp of the newest reference, ns; -1: none.
    """

    def __init__(self, **changes: object) -> None:
        values = {**PATIENT, **{n.replace("__", "."): v for n, v in changes.items()}}
        self.controller = Controller(resolve(controller_schema, values, 2))
        self.reference_stamp = -1
        self.sample = 0

    def reference(self, stamp: int) -> Array:
        motion, later = np.array([[0.5, -0.3], [0.4, 0.2], [0.0, 0.0]]), np.zeros((3, 2))
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


def test_without_a_reference_the_arm_is_held_where_it_starts() -> None:
    follower = Follower()
    follower.controller.position[:] = 0.7, -0.2
    for _ in range(5):
        np.testing.assert_array_equal(follower.step(), [[0.7, -0.2], [0.0, 0.0], [0.0, 0.0]])
        assert follower.mode == Mode.HOLDING


@pytest.mark.parametrize("sign", [1, -1], ids=["old", "ahead"])
def test_a_reference_is_followed_up_to_the_largest_age_and_again_at_half_of_it(sign: int) -> None:
    follower = Follower()
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
def test_the_reference_is_extrapolated_to_the_sample(age: int) -> None:
    follower = Follower(activation__blend=0.0)
    for _ in range(3):
        follower.refer(age)
        expected = follower.reference(START + follower.sample * MS)
        np.testing.assert_allclose(follower.step(), expected, rtol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 300.0])
@pytest.mark.parametrize("held", [0, 200])
def test_the_way_begins_with_the_present_motion_and_ends_on_the_reference(held: int, rate: float) -> None:
    """From the start, and after a position was held."""
    follower = Follower(activation__blend=0.3, limits__effort_rate=rate)
    follower.controller.position[:] = 0.1, 0.1
    motion = [follower.step() for _ in range(held)]
    ways = []
    for _ in range(3000):
        follower.refer()
        motion.append(follower.step())
        ways.append(follower.controller.state.way_duration[0])
    path = np.array(motion)
    if not held:
        np.testing.assert_allclose(path[0], [[0.1, 0.1], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)
    # The motion changes only as its derivatives require: it makes no step.
    for derivative in range(2):
        steps = np.diff(path[:, derivative], axis=0)
        mean = 0.5 * (path[1:, derivative + 1] + path[:-1, derivative + 1])
        np.testing.assert_allclose(steps, 0.001 * mean, atol=2e-4 if derivative else 1e-6)
    took = np.count_nonzero(ways)
    assert took == 300 if rate == 0.0 else 300 < took < 2500
    np.testing.assert_array_equal(path[-1], follower.reference(START + (follower.sample - 1) * MS))


@pytest.mark.parametrize("rate", [1000.0, 300.0, 100.0])
def test_with_a_rate_limit_the_way_is_long_enough_for_the_torque_to_follow(rate: float) -> None:
    follower = Follower(activation__blend=0.05, limits__effort_rate=rate)
    controller = follower.controller
    controller.position[:] = 0.1, 0.1
    efforts, effort = [], np.zeros((1, 2))
    for _ in range(3000):
        follower.refer()
        q, dq, ddq = follower.step()
        inverse_dynamics(controller.config.model, q, dq, ddq[None], effort)
        efforts.append(effort[0].copy())
    # The rest of the rate is for the law.
    assert np.abs(np.diff(efforts, axis=0)).max() < 0.6 * rate * 0.001
    assert controller.clock(Clock.AT_RATE_LIMIT) <= 1


def test_the_adaptation_is_approaching_while_there_is_a_way_to_a_reference() -> None:
    follower, seen = Follower(activation__blend=0.1), []
    for sample in range(600):
        if not 200 <= sample < 400:
            follower.refer()
        follower.step()
        seen.append(follower.controller.clock(Clock.ADAPTATION))
    approaching = [*range(100), *range(400, 500)]
    assert [k for k, adaptation in enumerate(seen) if adaptation == Adaptation.APPROACHING] == approaching
    assert set(seen) == {Adaptation.NORMAL, Adaptation.APPROACHING}
