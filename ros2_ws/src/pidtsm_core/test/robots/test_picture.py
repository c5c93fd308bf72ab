"""The size of an arm in pictures; its arcs and arrows are tested with the markers that show them."""

import pytest

from pidtsm_core.robots import find_description
from pidtsm_core.robots.picture import reach


def test_the_reach_is_the_length_of_the_stretched_arm() -> None:
    assert reach(find_description({})) == pytest.approx(1.85)
    # From the data sheet: 0.333 + 0.316 + 0.0825 + hypot(0.0825, 0.384) + 0.088 + 0.107 m.
    assert reach(find_description({"robot.description": "panda"})) == pytest.approx(1.319, abs=0.001)
