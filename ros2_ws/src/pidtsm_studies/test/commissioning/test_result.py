"""What a commissioning has measured has an interval."""

import json
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.result import parameter_file
from pidtsm_studies.commissioning.session import RefusedError, Session, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm

_COULOMB, _NOISE = 0.5, 2e-5


def test_values_and_their_intervals_are_in_the_file_and_hold_the_truth(tmp_path: Path) -> None:
    definition = ArmDefinition("scara")
    arm = definition.settings()
    before = make_experiment(None, params="practical", robot=definition).settings["controller"]
    session = Session.opened(tmp_path, Subject(arm, before, None, definition.described))
    plant = SimulatedArm({**arm, "rate": 250, "noise.std": _NOISE, "friction.coulomb": _COULOMB})
    with pytest.raises(RefusedError):
        session.run(plant, lambda step, _: step != "gains", lambda _: None, lambda _: None)
    rest, friction, identify = (session.found[step]["figures"] for step in ("rest", "friction", "identify"))
    assert np.allclose(rest["noise"], _NOISE, atol=2.0 * max(rest["noise_half_interval"]))
    assert np.allclose(friction["coulomb"][:2], _COULOMB, rtol=0.2)
    assert session.found["springs"]["verdict"].startswith("the joints are rigid as far as they can be shaken")
    half = identify["half_interval"]["coulomb"]
    found = identify["parameters"]["compensation.coulomb"]
    assert all(each is None or 0.0 < each < 0.02 for each in half)
    assert np.allclose(found, _COULOMB, atol=0.01)
    # The two last steps do not measure, so plain ones will do for the text.
    plain = {"verdict": "kept", "problems": [], "parameters": {}, "figures": {"better": True}}
    session.found |= {"gains": json.loads(json.dumps(plain)), "compare": plain}
    text = parameter_file(session, "commissioned.urdf")
    for part in ("# Noise of the positions: ", "± ", "combinations of masses", "(95 %"):
        assert part in text
