"""Which joints stick."""

import numpy as np
import pytest

from pidtsm_studies.commissioning.friction import moved_easily, sticking


@pytest.mark.parametrize(
    ("breakaway", "slides", "sticks"),
    [
        ([0.30, 0.17, 0.18], [0.13, 0.13, 0.14], [0]),
        ([0.30, 0.17, np.nan], [0.13, 0.13, 0.14], [0]),
        ([0.04, 0.01, 0.01], [0.01, 0.01, 0.01], []),  # Too little to mind.
        ([0.17, 0.17, 0.18], [0.05, 0.15, 0.15], []),  # Its sliding friction is not known well.
        ([0.30, 0.17, 0.18], [0.28, 0.13, 0.14], []),  # All its friction is large.
        ([0.20], [0.10], [0]),
        ([0.20], [0.15], []),
    ],
)
def test_a_joint_sticks_that_takes_more_than_the_others_and_than_to_slide(
    breakaway: list[float], slides: list[float], sticks: list[int]
) -> None:
    assert sticking(np.array(breakaway), np.array(slides)) == sticks


@pytest.mark.parametrize(
    ("nudged", "easily"),
    [
        ([12.0, 5.0, 6.0], True),
        ([30.0, 5.0, 6.0], False),
        ([None, 5.0, 6.0], False),
        ([12.0, None, None], False),  # There is nothing to compare it with.
        ([], False),
    ],
)
def test_a_joint_that_a_nudge_moved_as_easily_as_the_others_only_follows_badly(
    nudged: list[float | None], easily: bool
) -> None:
    assert moved_easily(nudged, np.array([100.0, 50.0, 50.0]), 0) == easily
