"""The effort of a reference is added to the command, counts as no disturbance, and comes and goes without a step."""

from typing import Any

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import Count
from pidtsm_core.laws import LAWS
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status, Violation

MS = 1_000_000
START = 1_000_000_000
SHARE = 0.1
"""What is fed forward, as a share of the limits, with alternating signs."""
REST = 0.1
"""s; the shortest time in which the desired motion comes to rest, and what is fed forward fades."""
STEEPEST = 1.875
"""Largest slope of a fade, as a multiple of the mean."""


class Follower:
    """A controller whose arm is always at its desired position, and a constant reference with an effort."""

    def __init__(self, arm: Arm, **changes: object) -> None:
        self.controller = arm.controller(**{"law.name": "computed_torque", **changes})
        self.effort = arm.alternating(SHARE) * arm.limits
        self.controller.position[:] = arm.start
        self.controller.given[0], self.controller.given[3] = arm.start, self.effort
        self.referred, self.sample = True, 0

    def step(self, samples: int) -> Array:
        """Return what is fed forward at so many samples, shape (samples, joints), N m."""
        fed = []
        for _ in range(samples):
            stamp = START + self.sample * MS
            self.controller.step(stamp, stamp if self.referred else -1)
            self.controller.position[:] = self.controller.state.desired[0]
            self.sample += 1
            fed.append(self.controller.state.feedforward_effort.copy())
        return np.array(fed)


def test_it_fades_in_along_the_approach_and_out_when_the_reference_is_lost(arm: Arm) -> None:
    """Also if the reference returns while it fades out."""
    follower = Follower(arm, activation__blend=0.3)
    fed = [follower.step(400)]
    np.testing.assert_array_equal(fed[0][0], 0.0)
    np.testing.assert_array_equal(fed[0][301:], np.broadcast_to(follower.effort, (99, arm.joints)))
    for referred, samples in ((False, 50), (True, 400), (False, 2500)):
        follower.referred = referred
        fed.append(follower.step(samples))
    assert (np.abs(fed[1][-1]) > 0.0).all()
    np.testing.assert_array_equal(fed[2][-1], follower.effort)
    np.testing.assert_array_equal(fed[3][-1], 0.0)
    steps = np.abs(np.diff(np.concatenate(fed), axis=0)) / np.abs(follower.effort)
    assert steps.max() <= 1.01 * STEEPEST * 0.001 / REST
    assert follower.controller.status[Status.MODE] == Mode.HOLDING


@pytest.mark.parametrize("rate", [10.0, 3.0, 1.0])
def test_with_a_rate_limit_the_approach_leaves_time_for_it(arm: Arm, rate: float) -> None:
    follower = Follower(arm, limits__effort_rate=(rate * arm.limits).tolist(), activation__blend=0.02)
    follower.step(2000)
    np.testing.assert_array_equal(follower.controller.state.feedforward_effort, follower.effort)
    assert follower.controller.state.counts[Count.AT_RATE_LIMIT] <= 2


def test_it_counts_for_the_limit_of_the_torque(arm: Arm) -> None:
    follower = Follower(arm, activation__blend=0.0)
    follower.controller.given[3] = 3.0 * arm.limits
    follower.step(2)
    np.testing.assert_array_equal(follower.controller.effort, arm.limits)
    assert (follower.controller.signals[Signal.SATURATED] == Limited.EFFORT).all()


def test_a_fault_ends_it_without_a_step(arm: Arm) -> None:
    follower = Follower(arm, activation__blend=0.0)
    follower.step(50)
    before = follower.controller.effort.copy()
    follower.sample += 100
    assert not follower.step(1).any()
    assert follower.controller.fault == Fault.STATE_STALE
    assert (np.abs(follower.controller.effort - before) <= 0.081 * arm.limits).all()


def pushed(arm: Arm, law: str, controller: dict[str, Any], load: Array, effort: Array) -> Recording:
    """A rollout with a constant load on the joints, N m."""
    settings = arm.motion(near=True)
    settings["controller"] |= {"law.name": law, **arm.gains(law), **controller}
    settings["simulator"] |= {"push.effort": load.tolist(), "push.duration": 10.0}
    settings["trajectory"] |= {"feedforward.effort": effort.tolist()}
    return rollout(**settings, duration=0.5)


OBSERVER = {"estimator.name": "extended_state_observer", "law.disturbance_rejection": True}
CONTROLLERS: list[tuple[str, dict[str, Any]]] = [(law, {}) for law in LAWS.names] + [
    (law, OBSERVER) for law in LAWS.names if LAWS[law].uses_model
]


@pytest.mark.parametrize(("law", "controller"), CONTROLLERS)
def test_an_arm_with_a_load_that_is_fed_forward_moves_as_without_the_load(
    arm: Arm, law: str, controller: dict[str, Any]
) -> None:
    """The laws, the observer and the recognition of contact take only the rest for a disturbance."""
    load = arm.alternating(SHARE) * arm.limits
    if LAWS[law].uses_model:
        controller = {**controller, "limits.external_effort": (0.5 * SHARE * arm.limits).tolist()}
    plain, fed = pushed(arm, law, controller, 0.0 * load, 0.0 * load), pushed(arm, law, controller, -load, load)
    np.testing.assert_allclose(fed.position, plain.position, atol=1e-7)
    np.testing.assert_allclose(fed.effort, plain.effort + load, atol=1e-3 * np.abs(load).max())
    assert not (fed.status[:, Status.VIOLATIONS] & Violation.EXTERNAL_EFFORT).any()
    alone = pushed(arm, law, controller, -load, 0.0 * load)
    assert np.abs(alone.position - plain.position).max() > 1e-4
