"""The first step: inverted torques and positions are named before anything moves far."""

import numpy as np
import pytest

from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.commissioning.arm import CommissionError, Measured, Wiring
from pidtsm_studies.commissioning.catch import FARTHEST
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.signs import find_signs
from pidtsm_studies.commissioning.simulated import SimulatedArm

ARM = ArmDefinition("ur5").settings()
HARDWARE = {
    "rate": 500,
    "encoder.bits": 17,
    "delay.samples": 1,
    "friction.coulomb": [2.0, 2.0, 1.0, 0.3, 0.3, 0.3],
    "model_error.mass": 0.2,
    "initial_position": [0.3, -1.0, 1.2, 0.2, 0.4, 0.1],
}


def wired(joint: int, of_position: bool) -> Wiring:
    wiring = Wiring.described(6)
    (wiring.position if of_position else wiring.effort)[joint] = -1.0
    return wiring


@pytest.mark.parametrize(
    "wiring",
    [Wiring.described(6), wired(1, of_position=False), wired(2, of_position=False), wired(5, of_position=True)],
    ids=["right", "torque of a loaded joint", "torque of the elbow", "position of the wrist"],
)
def test_inverted_joints_are_found_before_anything_moves_far(wiring: Wiring) -> None:
    told: list[str] = []
    signs = SimulatedArm({**ARM, **HARDWARE}, wiring).signs(ARM, told.append)
    found = signs.wiring.position * signs.wiring.effort
    assert found.tolist() == (wiring.position * wiring.effort).tolist()
    assert np.all(signs.moved < FARTHEST)
    assert bool(told) == (not wiring.is_described)
    for j in np.flatnonzero(found < 0.0):
        assert any(ArmModel(ARM).joints[j] in text for text in told)


@pytest.mark.parametrize("torque", [None, 1], ids=["alone", "with an inverted torque"])
def test_a_position_beyond_the_limits_is_inverted_from_the_first(torque: int | None) -> None:
    """The elbow of a Panda has only negative positions."""
    arm, wiring, told = ArmDefinition("panda").settings(), Wiring.described(7), list[str]()
    wiring.position[3] = -1.0
    if torque is not None:
        wiring.effort[torque] = -1.0
    hardware = {"rate": 500, "encoder.bits": 17, "friction.coulomb": 1.0}
    signs = SimulatedArm({**arm, **hardware}, wiring).signs(arm, told.append)
    assert signs.wiring.position.tolist() == wiring.position.tolist()
    assert signs.wiring.effort.tolist() == wiring.effort.tolist()
    assert "panda_joint4 is inverted: as it is, it is beyond the limits" in told[0]
    assert np.all(signs.moved < FARTHEST)


def test_a_joint_that_sticks_is_caught_once_it_breaks_away() -> None:
    """Its rotor, which the description lacks, makes it several times as heavy; friction no longer holds it."""
    wrist = {
        "robot.armature": [0.1, 0.1, 0.1, 0.02, 0.02, 0.02],
        "rate": 1000,
        "friction.coulomb": [0.6, 0.6, 0.6, 0.15, 0.15, 0.15],
        "friction.static": [0.6, 0.6, 0.6, 0.15, 0.15, 5.0],
        "friction.bristle_stiffness": 2e4,
        "friction.stribeck_velocity": 0.02,
        "model_error.mass": 0.0,
    }
    signs = SimulatedArm({**ARM, **HARDWARE, **wrist}, wired(5, of_position=False)).signs(ARM, lambda _: None)
    assert signs.known_by[5] == "nudge"
    assert signs.wiring.position[5] * signs.wiring.effort[5] == -1.0
    assert np.all(signs.moved < FARTHEST)


class _Falling:
    """An arm whose torques do nothing."""

    period = 0.002

    def __init__(self) -> None:
        self.q, self.v, self.stamp, self.efforts = np.full(6, 0.5), np.zeros(6), 0, 0

    def sense(self) -> Measured:
        self.stamp += 2_000_000
        return Measured(self.stamp, self.q.copy())

    def act(self, effort: object) -> None:
        if effort is None:
            self.v[:] = 0.0
            return
        self.efforts += 1
        self.v -= 3.0 * self.period
        self.q += self.v * self.period


def test_commands_cease_where_nothing_holds_the_arm() -> None:
    arm = _Falling()
    with pytest.raises(CommissionError, match=r"moves away .* commands have ceased"):
        find_signs(arm, ArmModel(ARM), lambda _: None)
    # Four tries, each of which ends soon after the limit.
    assert np.all(np.abs(arm.q - 0.5) < 4.0 * 1.3 * FARTHEST)
