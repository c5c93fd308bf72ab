"""Efforts change on straight lines, from the present one, and never in steps."""

import numpy as np

from pidtsm_core.trajectories.feed_forward import FADE, fade, follow


def test_efforts_go_from_the_present_one_to_those_of_later_points() -> None:
    times, efforts = np.array([1.0, 3.0, 4.0]), np.array([[9.0, 9.0], [6.0, -2.0], [0.0, -2.0]])
    line = follow(2.0, np.array([4.0, 0.0]), times, efforts)
    for t, expected in (
        (0.0, (4.0, 0.0)),
        (2.5, (5.0, -1.0)),
        (3.0, (6.0, -2.0)),
        (3.5, (3.0, -2.0)),
        (9.0, (0.0, -2.0)),
    ):
        np.testing.assert_allclose(line.evaluate(t), expected)


def test_an_effort_fades_to_zero() -> None:
    line = fade(1.0, np.array([4.0, -2.0]))
    for t, efforts in ((1.0, (4.0, -2.0)), (1.0 + FADE / 2, (2.0, -1.0)), (1.0 + FADE, (0.0, 0.0)), (9.0, (0.0, 0.0))):
        np.testing.assert_allclose(line.evaluate(t), efforts)
