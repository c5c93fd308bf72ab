"""Properties of the members of every family."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS
from pidtsm_core.laws.reaching import REACHING_LAWS
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters import Parameter
from pidtsm_core.parameters.family import SLOTS, Family, Member
from pidtsm_core.references import REFERENCES
from pidtsm_core.robots import ROBOTS
from pidtsm_core.simulation.disturbances import DISTURBANCES

FAMILIES: dict[str, Family[Any]] = {
    "disturbances": DISTURBANCES,
    "estimators": ESTIMATORS,
    "laws": LAWS,
    "reaching": REACHING_LAWS,
    "references": REFERENCES,
    "robots": ROBOTS,
    "surfaces": SURFACES,
}
PACKED = [
    member
    for family in ("disturbances", "estimators", "reaching", "references", "surfaces")
    for member in FAMILIES[family].members
    if type(member).pack is Member.pack  # A motion of segments packs these instead.
]


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
def test_members_are_found_by_name_and_number(family: Family[Any]) -> None:
    assert family.members
    for number, member in enumerate(family.members):
        assert family[member.name] is member
        assert family.index(member.name) == number
        assert member.summary.strip()


@pytest.mark.parametrize("member", PACKED, ids=lambda m: m.name)
def test_members_fit_their_slots_with_one_number_a_parameter(member: Member) -> None:
    assert len(member.parameters) <= SLOTS
    values = {f"group.{p.name}": float(i + 1) for i, p in enumerate(member.parameters)}
    count = len(member.parameters)
    packed = member.pack(values, "group", 3)
    assert packed.shape == (3, SLOTS)
    np.testing.assert_array_equal(packed, np.tile([*range(1, count + 1), *[0] * (SLOTS - count)], (3, 1)))


def test_pack_keeps_values_of_each_joint_apart() -> None:
    member = Member("m", "s", (Parameter("a", 1.0, "a", per_joint=True), Parameter("b", 1.0, "b")))
    packed = member.pack({"g.a": (1.0, 2.0), "g.b": 3.0}, "g", 2)
    assert packed[:, :2].tolist() == [[1.0, 3.0], [2.0, 3.0]]
    assert not packed[:, 2:].any()


def test_two_members_of_one_name_are_refused() -> None:
    member = Member("same", "s", ())
    with pytest.raises(ValueError, match="same"):
        Family(Member, "members", member, member)
