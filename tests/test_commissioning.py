"""Commissioning over ROS of a stranger's plant: 20 % heavier, with permuted names and an inverted torque."""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support.heavyplant import INVERTED, RATE, HeavyPlant, heavy_plant

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_experiments.commissioning.remote import RemoteArm, release
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_ros.middleware import set_defaults
from pidtsm_studies.commissioning.bench import Plan
from pidtsm_studies.commissioning.session import RefusedError, Session, Subject

DEFINITION = ArmDefinition(
    str(Path(__file__).parents[1] / "ros2_ws/src/two_link_sim/urdf/two_link.urdf"), effort=(120.0, 80.0)
)
ARM = DEFINITION.settings()
HELD = 0.03
"""rad; an arm that is held moves less."""


@pytest.fixture
def plant(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[HeavyPlant, dict[str, str]]]:
    set_defaults()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as domain, heavy_plant(domain) as running:
        yield running, {**os.environ, "ROS_DOMAIN_ID": str(domain)}


def test_an_inverted_torque_is_named_first_and_the_arm_is_held_when_the_session_is_gone(
    plant: tuple[HeavyPlant, dict[str, str]], tmp_path: Path
) -> None:
    arm, environment = plant
    before: dict[str, Any] = dict(
        make_experiment(None, params="practical", robot=DEFINITION, overrides={"simulator": {"rate": RATE}}).settings[
            "controller"
        ]
    )
    folder = tmp_path / "session"
    session = Session.opened(folder, Subject(ARM, before, None, DEFINITION.described))
    named: list[float] = []

    def tell(text: str) -> None:
        if INVERTED in text and "inverted" in text:
            named.append(arm.moved)

    def until(last: str) -> Any:
        def asked(step: str, _plan: Plan) -> bool:
            return step != last

        return asked

    try:
        with RemoteArm(folder, ARM, environment=environment) as remote:
            assert remote.period == pytest.approx(1.0 / RATE)
            with pytest.raises(RefusedError):
                session.run(remote, until("lateness"), tell, lambda _: None)
        assert named[0] < 0.02
        assert session.found["signs"]["figures"]["effort"] == [1.0, -1.0]
        assert session.found["rest"]["figures"]["rate"] == pytest.approx(RATE, rel=0.01)
        # The session is gone: commands go on, and the arm stays, whatever else is on the topic.
        at, commands = arm.q.copy(), arm.commands
        arm.nonsense = [
            JointState(name=["joint1", "joint2"], position=[math.nan, 0.6]),
            JointState(name=["joint1", "joint2"], position=[0.4]),
            JointState(name=["finger"], position=[0.01]),
        ]
        while arm.commands < commands + RATE:
            arm.wait()
        assert not arm.braked
        arm.nonsense = []
        assert np.abs(arm.q - at).max() < HELD
        with RemoteArm(folder, ARM, environment=environment) as remote:
            assert remote.was_held
            again = Session.opened(folder, session.subject)
            assert again.missing[0] == "lateness"
            with pytest.raises(RefusedError):
                again.run(remote, until("friction"), tell, lambda _: None)
        assert np.abs(arm.q - at).max() < HELD
    finally:
        assert release(folder)
    commands = arm.commands
    while not arm.braked:
        arm.wait()
    assert arm.commands <= commands + 1
