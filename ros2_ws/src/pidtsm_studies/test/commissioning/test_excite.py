"""An identified arm is refused where it takes a joint for far too light: what sticks hides inertias."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core import robots
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.bench import Bench
from pidtsm_studies.commissioning.excite import implausibly_light
from pidtsm_studies.commissioning.room import Room

DEFINITION = ArmDefinition("scara")


@pytest.mark.parametrize(("rotor", "words"), [(0.5, ""), (0.01, "joint4 is identified as 0.0")])
def test_a_joint_that_is_far_too_light_is_not_believed(tmp_path: Path, rotor: float, words: str) -> None:
    text = Path(robots.__file__).with_name("arms").joinpath("scara.urdf").read_text(encoding="utf-8")
    lighter = tmp_path / "lighter.urdf"
    lighter.write_text(text.replace('rotor_inertia value="5e-06"', f'rotor_inertia value="{5e-6 * rotor}"'))
    settings: dict[str, Any] = DEFINITION.settings()
    loop: Any = None  # Nothing moves.
    bench = Bench(settings, settings, None, np.zeros(4), loop, {}, print, DEFINITION.described, Room(settings, ""))
    found = implausibly_light(bench, ArmDefinition(str(lighter)).settings())
    assert found.startswith(words)
    assert bool(found) == bool(words)
