"""The first step: inverted torques and positions are named before anything moves far."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.hardware_classes import hardware_settings
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


def test_a_joint_that_leaps_away_is_named_as_one_that_sticks() -> None:
    """Its drive is too late to catch it."""
    arm = ArmDefinition("scara").settings()
    sticky = {"friction.static": [0.5, 19.5, 0.5, 0.5], "friction.bristle_stiffness": 2e4}
    late = {"rate": 500, "encoder.bits": 16, "delay.samples": 6, "dropout.probability": 0.02}
    settings = {**arm, **late, **sticky, "friction.coulomb": 0.5, "friction.stribeck_velocity": 0.02}
    with pytest.raises(CommissionError, match=r"joint2 moves away .*joint states are lost; joint2 needs .* to stick"):
        SimulatedArm(settings).signs(arm, lambda _: None)


_LINK = (
    '<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
    '<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>'
    '<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="3" effort="{effort}"/></joint>'
)
LIGHT_WRIST = (
    '<robot name="light"><link name="base"/>'
    + _LINK.format(name="arm", x=0.15, mass=3.0, inertia=0.02)
    + _LINK.format(name="hand", x=0.02, mass=0.6, inertia=0.0005)
    + _JOINT.format(name="elbow", parent="base", child="arm", x=0, axis="0 1 0", effort=60)
    + _JOINT.format(name="wrist", parent="arm", child="hand", x=0.3, axis="1 0 0", effort=8)
    + "</robot>"
)
"""An arm whose torque limit accelerates its wrist by 16,000 rad/s^2 by its description, and in truth by 200."""


@pytest.mark.parametrize("has_rotors", [True, False], ids=["with rotors", "without"])
@pytest.mark.parametrize("hardware", ["collaborative", "direct_drive", "geared"])
def test_rotors_that_the_description_lacks_are_found_where_they_are(
    tmp_path: Path, hardware: str, has_rotors: bool
) -> None:
    """A wrist that is as light as it is described is neither thrown nor taken for heavy."""
    file = tmp_path / "light.urdf"
    file.write_text(LIGHT_WRIST, encoding="utf-8")
    arm = ArmDefinition(str(file)).settings()
    true = {**arm, "robot.armature": [0.3, 0.04]} if has_rotors else arm
    settings = {**true, **hardware_settings(hardware, arm), "initial_position": [0.3, 0.4]}
    if not has_rotors:  # Elastic joints need them.
        settings |= {name: 0.0 for name in settings if name in ("elasticity.stiffness", "elasticity.damping")}
    signs = SimulatedArm(settings).signs(arm, lambda _: None)
    inertia = ArmModel(true).inertia(signs.position[0])[1, 1]
    assert signs.known_by[1] == "nudge"
    assert np.all(signs.moved < FARTHEST)
    assert not signs.inertia[1] > 1.4 * inertia
    assert signs.inertia[1] > 0.6 * inertia or not has_rotors


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


PLANAR = (
    '<robot name="planar"><link name="base"/>'
    + _LINK.format(name="arm", x=0.2, mass=3.0, inertia=0.03)
    + _LINK.format(name="forearm", x=0.15, mass=2.0, inertia=0.02)
    + _JOINT.format(name="shoulder", parent="base", child="arm", x=0, axis="0 0 1", effort=60)
    + _JOINT.format(name="elbow", parent="arm", child="forearm", x=0.4, axis="0 0 1", effort=25)
    + "</robot>"
)
"""Two joints about vertical axes: gravity tells nothing of them."""


class _InMujoco:
    """An arm in MuJoCo, with brakes that hold it whenever no torque comes."""

    def __init__(self, text: str, start: list[float], period: float, friction: float, wiring: Wiring) -> None:
        self.period = period
        self.model = mujoco.MjModel.from_xml_string(text)
        self.model.opt.timestep = 0.25 * self.period
        self.model.dof_frictionloss[:] = friction
        self.data, self.wiring = mujoco.MjData(self.model), wiring
        self.data.qpos[:] = start

    def sense(self) -> Measured:
        step = 2.0 * np.pi / 2.0**17
        position = self.wiring.position * np.round(self.data.qpos / step) * step
        return Measured(round(1e9 * self.data.time), position)

    def act(self, effort: Array | None) -> None:
        if effort is None:
            self.data.qvel[:] = 0.0
            self.data.time += self.period
            return
        self.data.qfrc_applied[:] = self.wiring.effort * effort
        mujoco.mj_step(self.model, self.data, nstep=4)


@pytest.mark.parametrize(("period", "friction"), [(0.001, 0.1), (0.004, 0.8)])
@pytest.mark.parametrize("of_position", [True, False], ids=["position", "torque"])
@pytest.mark.parametrize("joint", [0, 1])
def test_couplings_tell_an_inverted_position_from_an_inverted_torque(
    tmp_path: Path, joint: int, of_position: bool, period: float, friction: float
) -> None:
    file = tmp_path / "planar.urdf"
    file.write_text(PLANAR, encoding="utf-8")
    wiring = Wiring.described(2)
    (wiring.position if of_position else wiring.effort)[joint] = -1.0
    told = list[str]()
    model = ArmModel(ArmDefinition(str(file)).settings())
    signs, _ = find_signs(_InMujoco(PLANAR, [0.4, 0.7], period, friction, wiring), model, told.append)
    assert signs.wiring.position.tolist() == wiring.position.tolist()
    assert signs.wiring.effort.tolist() == wiring.effort.tolist()
    assert f"it is the {'position' if of_position else 'torque'} that" in told[-1]
    assert np.all(signs.moved < FARTHEST)
