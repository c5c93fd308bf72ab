"""Units belong to the kind of a joint, and joints of the same kind are shown together."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pidtsm_core.robots import NAMES, find_robot
from pidtsm_core.units import SLIDES, TURNS, alike, either, joint_units


@pytest.mark.parametrize("name", NAMES)
def test_only_the_scara_has_a_joint_that_slides(name: str) -> None:
    robot = find_robot({"robot.description": name})
    assert robot.units == ((TURNS, TURNS, SLIDES, TURNS) if name == "scara" else (TURNS,) * len(robot.joints))


@given(slides=st.lists(st.booleans(), min_size=1, max_size=12), most=st.integers(1, 5))
def test_groups_have_one_unit_and_about_the_same_size(slides: list[bool], most: int) -> None:
    groups = alike(joint_units(slides, len(slides)), most)
    assert sorted(joint for group in groups for joint in group) == list(range(len(slides)))
    for kind in set(slides):
        sizes = [len(group) for group in groups if slides[group[0]] == kind]
        assert max(sizes) <= most
        assert max(sizes) - min(sizes) <= 1
        assert len(sizes) == -(-slides.count(kind) // most)
    assert all(len({slides[joint] for joint in group}) == 1 for group in groups)


def test_a_text_about_several_joints_names_each_unit_once() -> None:
    assert either(units.effort for units in joint_units((False, True, False), 3)) == "N m or N"
    assert either(units.position for units in joint_units((), 2)) == "rad"
