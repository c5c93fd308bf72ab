"""What links look like, of a URDF with primitives and meshes."""

from pathlib import Path

import numpy as np
import pytest

from pidtsm_studies.reports.shapes import shapes_of


def visual(geometry: str, origin: str = "") -> str:
    return f"<visual>{origin}<geometry>{geometry}</geometry></visual>"


def test_shapes_and_meshes_that_exist_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.stl").touch()
    (tmp_path / "secret.txt").touch()
    turned = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    parts = [
        visual('<box size="1 2 3"/>', turned),
        visual('<cylinder radius="0.1" length="0.5"/>'),
        visual('<sphere radius="0.2"/>'),
        visual(f'<mesh filename="file://{tmp_path}/a.stl" scale="0.001 0.001 0.001"/>'),
        *(visual(f'<mesh filename="{name}"/>') for name in ("package://none/a.stl", f"{tmp_path}/secret.txt", "a.stl")),
    ]
    found, lacking = shapes_of(f"<robot><link name='base'/><link name='arm'>{''.join(parts)}</link></robot>")
    assert [*found] == ["arm"]
    assert [(shape.kind, shape.size) for shape in found["arm"]] == [
        ("box", (1.0, 2.0, 3.0)),
        ("cylinder", (0.1, 0.5)),
        ("sphere", (0.2,)),
        ("mesh", (0.001, 0.001, 0.001)),
    ]
    np.testing.assert_allclose(found["arm"][0].translation, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found["arm"][0].turn, [0.0, 0.0, 0.5**0.5, 0.5**0.5])
    assert found["arm"][3].file == tmp_path / "a.stl"
    assert lacking == 3


@pytest.mark.parametrize(
    "part",
    [
        visual('<box size="1 2"/>'),
        visual('<sphere radius="big"/>'),
        visual('<cylinder radius="0.1"/>'),
        visual('<box size="1 2 3"/>', '<origin xyz="1 2"/>'),
        visual('<box size="1 2 nan"/>'),
        visual('<cone radius="1"/>'),
        "<visual/>",
    ],
)
def test_what_cannot_be_drawn_is_left_out(part: str) -> None:
    assert shapes_of(f"<robot><link name='arm'>{part}</link></robot>") == ({}, 0)


def test_an_mjcf_has_no_shapes() -> None:
    assert shapes_of("") == ({}, 0)
