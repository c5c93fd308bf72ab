"""Motions of the steps begin and end at rest, keep their limits, and have the derivatives that they claim."""

import numpy as np
import pytest

from pidtsm_studies.commissioning.motions import STEP, Motion, chirp, joined, periodic, rest, straight, sweeps

MIDDLE, REACH = np.array([0.2, -0.4]), np.array([0.3, 0.1])
MOTIONS = {
    "straight": straight(MIDDLE, MIDDLE + REACH, np.array([0.5, 0.5]), np.array([2.0, 2.0])),
    "chirp": chirp(MIDDLE, 0.1 * REACH, 2.0, 8.0, 2.0),
    "periodic": periodic(MIDDLE, np.array([REACH, 0.3 * REACH]), 0.25, 5.0),
    "sweeps": sweeps(MIDDLE, REACH, (0.2, 0.4), 1.5),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_are_at_rest_at_both_ends_and_have_their_derivatives(name: str) -> None:
    motion = MOTIONS[name]
    q, dq, ddq = motion.states
    assert np.all(motion.states[1:, [0, -1]] == 0.0)
    for values, rate in ((q, dq), (dq, ddq)):
        inner = np.gradient(values, STEP, axis=0)[2:-2]
        assert np.abs(inner - rate[2:-2]).max() < 0.03 * np.abs(rate).max() + 0.02


def test_straight_motions_keep_their_limits_and_sweeps_their_speeds() -> None:
    _, dq, ddq = MOTIONS["straight"].states
    assert np.abs(dq).max() <= 0.5 * 1.01
    assert np.abs(ddq).max() <= 2.0 * 1.01
    assert np.abs(MOTIONS["sweeps"].states[1]).max() == pytest.approx(0.4, rel=0.02)


def test_a_joined_motion_is_one_after_the_other_and_rests_beyond_its_end() -> None:
    both = joined(rest(MIDDLE, 0.5), MOTIONS["straight"])
    assert isinstance(both, Motion)
    assert both.duration == pytest.approx(0.5 + MOTIONS["straight"].duration)
    state = np.empty((3, 2))
    both.at(both.duration + 1.0, state)
    assert state[0] == pytest.approx(MIDDLE + REACH)
    assert np.all(state[1:] == 0.0)
