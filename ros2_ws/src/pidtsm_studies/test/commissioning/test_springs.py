"""The step that shakes an arm finds its springs, and from then on the controllers know them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.gains import rotors
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning import springs
from pidtsm_studies.commissioning.arm import Wiring
from pidtsm_studies.commissioning.bench import Bench
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import STEP, Motion
from pidtsm_studies.commissioning.room import Room
from pidtsm_studies.commissioning.session import NAMES, RefusedError, Session, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm

DEFINITION = ArmDefinition("scara")
ARM = DEFINITION.settings()
BEFORE = make_experiment(None, params="practical", robot=DEFINITION).settings["controller"]


def shaken(folder: Path, hardware: str) -> tuple[dict[str, Any], Bench, dict[str, Any]]:
    """What was found of the SCARA with hardware of a class, what the next step has, and the truth."""
    settings = {**ARM, **hardware_settings(hardware, ARM)}
    plant, session = SimulatedArm(settings), Session.opened(folder, Subject(ARM, BEFORE, None, DEFINITION.described))
    with pytest.raises(RefusedError):
        session.run(plant, lambda step, _: step != "identify", lambda _: None, lambda _: None)
    loop = plant.follower(NAMES.index("identify"), Wiring.described(4))
    return session.found["springs"], session.bench(loop, lambda _: None), settings


@pytest.mark.parametrize(("hardware", "encoder"), [("geared", "motor"), ("collaborative", "link")])
def test_the_springs_of_an_arm_are_found_and_used(tmp_path: Path, hardware: str, encoder: str) -> None:
    found, bench, settings = shaken(tmp_path, hardware)
    figures = found["figures"]
    assert figures["encoder"] == encoder
    true = np.array(settings["elasticity.stiffness"])
    np.testing.assert_allclose(figures["stiffness"], true, rtol=0.3)
    assert figures["stiffness"][2] == 0.0, "the third joint slides"
    np.testing.assert_allclose(figures["rotor"], rotors(ARM), rtol=0.3)
    # A sample, and the lag of the drives.
    late = 1.0 / settings["rate"] + settings.get("actuator.lag", np.sqrt(2.0) / settings.get("actuator.frequency", 1.0))
    assert figures["delay"] == pytest.approx(late, abs=0.0006)
    controller = bench.controller()
    assert controller["estimator.name"] == "elastic_joint_observer"
    assert controller["estimator.stiffness"] == pytest.approx(figures["stiffness"])
    assert controller["estimator.at_links"] == (encoder == "link")


class _Unrelated:
    """Vibrates, whatever the torque."""

    period = STEP

    def follow(self, _settings: Mapping[str, Any], motion: Motion) -> Samples:
        states = motion.states.transpose(1, 0, 2)
        time = np.asarray(STEP * np.arange(len(states)), dtype=np.float64)
        vibration = 1e-3 * np.sin(2.0 * np.pi * np.outer(time, [13.0, 21.0, 31.0, 43.0]))
        assert motion.shaking is not None
        return Samples(np.round(1e9 * time).astype(np.int64), states[:, 0] + vibration, motion.shaking, states, 0)


def test_what_explains_nothing_is_not_believed() -> None:
    known = {"rest": {"noise": [1e-5] * 4, "step": [0.0] * 4, "rate": 1.0 / STEP, "bits": 16}}
    told = (known, lambda _: None, DEFINITION.described, Room(ARM, ""))
    bench = Bench(ARM, BEFORE, None, np.zeros(4), _Unrelated(), *told)
    outcome = springs.run(bench)
    assert outcome.problems == ["neither rigid nor elastic joints explain how the arm moves"]
    assert not outcome.parameters
    assert not {"stiffness", "rotor", "delay"} & set(outcome.figures)
