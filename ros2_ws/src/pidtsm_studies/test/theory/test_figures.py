"""The figures show the run and what theory has for it."""

from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters.family import SLOTS
from pidtsm_studies import check_gains
from pidtsm_studies.theory.figures import gain, phase, sliding, surface_velocity, write_theory_figures
from pidtsm_studies.theory.parts import Parts


def test_all_figures_are_written(tmp_path: Path) -> None:
    check = check_gains("case2", duration=0.3)
    assert check.recording is not None
    assert check.bounds is not None
    files = write_theory_figures(check.recording, check.bounds, tmp_path / "figures")
    assert {file.name for file in files} == {
        f"{name}.{kind}" for name in ("phase", "sliding", "gain") for kind in ("png", "svg")
    }


def test_they_have_a_panel_for_each_joint() -> None:
    check = check_gains("case1", duration=0.3)
    assert check.recording is not None
    assert check.bounds is not None
    assert [len(each(check.recording, check.bounds).axes) for each in (phase, sliding, gain)] == [2, 3, 2]
    labels = [drawn.get_label() for drawn in phase(check.recording, check.bounds).axes[0].lines]
    assert "$s = 0$" in labels


@pytest.mark.parametrize("surface", SURFACES.members, ids=lambda surface: surface.name)
def test_on_the_drawn_curve_s_is_zero(surface: object) -> None:
    member = SURFACES[surface.name]  # type: ignore[attr-defined]
    gains = {each.name: np.array([each.default], dtype=np.float64) for each in member.parameters}
    drawn = surface_velocity(np.linspace(-0.3, 0.5, 9), Parts("", member.name, "none", "constant", gains, 1), 0)
    if member.name == "integral":
        assert drawn is None
        return
    assert drawn is not None
    p = np.zeros(SLOTS)
    p[: len(member.parameters)] = [each.default for each in member.parameters]
    for e, de in zip(*drawn, strict=True):
        assert member.evaluate(float(e), float(de), 0.0, p)[0] == pytest.approx(0.0, abs=1e-12)
