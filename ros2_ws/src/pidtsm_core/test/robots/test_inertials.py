"""Impossible inertias: they refuse an arm only where they matter, and MuJoCo leaves no file behind."""

import math
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.rigid_bodies import described_bodies
from pidtsm_core.robots.tree.layout import Column, inertia_matrix, rows, steiner

GOOD, IMPOSSIBLE, NEGATIVE, NONE = (0.02, 0.03, 0.04), (0.02, 0.03, 0.4), (0.02, 0.03, -0.04), (0.0, 0.0, 0.0)


def link(name: str, inertia: tuple[float, float, float] = GOOD, mass: float = 2.0) -> str:
    xx, yy, zz = inertia
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0.02" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name: str, parent: str, child: str, kind: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="1" effort="30" velocity="2"/></joint>'
    )


def arm(**inertias: tuple[float, float, float]) -> str:
    """A mast with a camera, a lift that is to be locked, two links, and on the second a cover and a finger."""
    pairs = (("mast", "camera", "fixed"), ("mast", "lift", "prismatic"), ("lift", "upper", "revolute"))
    behind = (("upper", "lower", "revolute"), ("lower", "cover", "fixed"), ("lower", "finger", "prismatic"))
    joints = "".join(joint(f"to_{child}", parent, child, kind) for parent, child, kind in (*pairs, *behind))
    names = ("mast", "camera", "lift", "upper", "lower", "cover", "finger")
    light = {"cover": 0.05, "finger": 0.05}
    links = "".join(link(name, inertias.get(name, GOOD), light.get(name, 2.0)) for name in names)
    return f'<robot name="arm">{links}{joints}</robot>'


CHOSEN = ("to_upper", "to_lower")


@pytest.mark.parametrize("inertia", [IMPOSSIBLE, NEGATIVE, NONE], ids=["triangle", "negative", "zero"])
@pytest.mark.parametrize("where", ["mast", "camera", "lift"])
def test_the_inertia_of_a_link_that_does_not_move_does_not_matter(
    where: str, inertia: tuple[float, float, float]
) -> None:
    np.testing.assert_array_equal(
        read_description(arm(**{where: inertia}), CHOSEN).tree, read_description(arm(), CHOSEN).tree
    )


@pytest.mark.parametrize("where", ["cover", "finger"])
def test_a_link_on_a_moving_one_matters_only_with_it(where: str) -> None:
    merged = read_description(arm(**{where: (1e-5, 1e-5, 3e-5)}), CHOSEN)
    possible = read_description(arm(**{where: (1e-5, 1e-5, 2e-5)}), CHOSEN)
    difference = rows(merged.tree)[1] - rows(possible.tree)[1]
    assert math.isclose(difference[Column.INERTIA : Column.INERTIA + 3].sum(), 1e-5, rel_tol=1e-6)
    with pytest.raises(DescriptionError, match=f"link {where}: no body has its inertia"):
        read_description(arm(**{where: (0.1, 0.1, 9.0)}), CHOSEN)
    assert described_bodies(merged).compile().nv == 2


@pytest.mark.parametrize(
    ("inertia", "cause"),
    [(IMPOSSIBLE, "no body has its inertia"), (NEGATIVE, "no body has its inertia"), (NONE, "a mass, but no inertia")],
    ids=["triangle", "negative", "zero"],
)
def test_the_inertia_of_a_moving_link_matters(inertia: tuple[float, float, float], cause: str) -> None:
    with pytest.raises(DescriptionError, match=cause) as refused:
        read_description(arm(upper=inertia), CHOSEN)
    assert refused.value.element == ("link", "upper")


def test_an_inertia_that_rounding_made_impossible_becomes_the_next_possible_one() -> None:
    found = read_description(arm(upper=(0.0100, 0.0200, 0.0301)), CHOSEN)
    row = rows(found.tree)[0]
    center = row[Column.MOMENT : Column.INERTIA] / row[Column.MASS]
    principal = np.linalg.eigvalsh(inertia_matrix(row) - row[Column.MASS] * steiner(center))
    np.testing.assert_allclose(principal, (0.01, 0.02, 0.0301), atol=1.1e-4)
    assert principal[0] + principal[1] >= principal[2]
    assert described_bodies(found).compile().nv == 2


def test_no_file_of_mujoco_is_left_in_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # MuJoCo warns of a range without room, which does not matter for joints that are locked.
    read_description(arm().replace('upper="1"', 'upper="-2"', 2), CHOSEN)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []
