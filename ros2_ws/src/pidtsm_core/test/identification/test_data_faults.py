"""Data that are wrong are named."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.knownarm import STEP, KnownArm, known_arm, periodic_motion

from pidtsm_core.arrays import Array
from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.identification import IdentificationError, identify
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.robots import find_description
from pidtsm_core.robots.description import read_description


def swapped(measured: Measurement, _: Array) -> Measurement:
    order = np.array([1, 0, 2, 3, 4, 5, 6])
    return replace(measured, position=measured.position[:, order], effort=measured.effort[:, order])


def still(measured: Measurement, _: Array) -> Measurement:
    return replace(measured, position=measured.position[:1] + 1e-3 * np.sin(measured.time)[:, np.newaxis])


def alone(measured: Measurement, _: Array) -> Measurement:
    only = np.arange(7) == 2
    return replace(measured, position=np.where(only, measured.position, measured.position[:1]))


def signed(measured: Measurement, _: Array) -> Measurement:
    return replace(measured, effort=measured.effort * np.where(np.arange(7) == 3, -1.0, 1.0))


def turned(measured: Measurement, _: Array) -> Measurement:
    return replace(measured, position=measured.position * np.where(np.arange(7) == 1, -1.0, 1.0))


def opposite(measured: Measurement, _: Array) -> Measurement:
    return replace(measured, effort=-measured.effort)


FAULTS: dict[str, tuple[Callable[[Measurement, Array], Measurement], str]] = {
    "still": (still, "the arm stands still"),
    "one joint": (alone, "only panda_joint3 moves"),
    "swapped": (swapped, "the data of panda_joint1 and panda_joint2 are swapped"),
    "torque sign": (signed, "the sign of the torque of panda_joint4 is wrong"),
    "position sign": (turned, "the sign of the position of panda_joint2 is wrong"),
    "all signs": (opposite, "the signs of all torques are wrong"),
    "no gravity": (lambda m, gravity: replace(m, effort=m.effort - gravity), "lack gravity"),
    "gravity twice": (lambda m, gravity: replace(m, effort=m.effort + gravity), "contain gravity twice"),
    "other names": (lambda m, _: replace(m, joints=tuple("abcdefg")), "the joint states lack panda_joint1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_nothing_is_fitted(panda: KnownArm, fault: str) -> None:
    spoil, message = FAULTS[fault]
    q = panda.measured.position
    gravity = regressor(panda.described.tree, q, 0.0 * q, 0.0 * q)[..., :70] @ panda.truth[:70]
    with pytest.raises(IdentificationError, match=message):
        identify(panda.described, [spoil(panda.measured, gravity)])


@pytest.mark.parametrize("fault", ["no gravity", "gravity twice"])
@pytest.mark.parametrize("seed", [6, 8, 12])
def test_gravity_is_judged_with_masses_that_are_elsewhere_than_described(fault: str, seed: int) -> None:
    arm = known_arm("two_link", seed)
    spoil, message = FAULTS[fault]
    q = arm.measured.position
    gravity = regressor(arm.described.tree, q, 0.0 * q, 0.0 * q)[..., :20] @ arm.truth[:20]
    with pytest.raises(IdentificationError, match=message):
        identify(arm.described, [spoil(arm.measured, gravity)])


def test_masses_that_are_much_too_small_are_no_gravity_that_counts_twice(panda: KnownArm) -> None:
    described = panda.described
    links = described_parameters(described.tree, described.damping, described.friction)
    links[:70] *= 0.55
    light = read_description(corrected_urdf(described, links))
    found = identify(light, [panda.measured])
    assert np.mean(found.check.error(found.check.after) / panda.noise) < 0.5
    q = panda.measured.position
    gravity = regressor(described.tree, q, 0.0 * q, 0.0 * q)[..., :70] @ panda.truth[:70]
    with pytest.raises(IdentificationError, match="contain gravity twice"):
        identify(light, [replace(panda.measured, effort=panda.measured.effort + gravity)])


def test_the_torques_of_another_arm_are_refused(panda: KnownArm) -> None:
    other = find_description({"robot.description": "xarm7"})
    with pytest.raises(IdentificationError, match="another robot"):
        identify(other, [replace(panda.measured, joints=other.joints)])


def test_lost_samples_are_named_and_do_no_harm(panda: KnownArm) -> None:
    measured = panda.measured
    kept = np.random.default_rng(0).random(measured.time.size) > 0.05
    kept[2000:2100] = False
    found = identify(
        panda.described,
        [replace(measured, time=measured.time[kept], position=measured.position[kept], effort=measured.effort[kept])],
    )
    assert "% of the samples are missing" in found.warnings[0]
    error = np.abs(found.fit.beta - found.base.mapping @ panda.truth) / found.fit.deviation
    assert np.mean(error**2) < 2.0


def test_saturated_torques_are_named_and_not_used(panda: KnownArm) -> None:
    """A drive at its limit delivers less than it reports."""
    measured = panda.measured
    effort = measured.effort.copy()
    effort[:, 1] = np.clip(effort[:, 1], *(np.percentile(np.abs(effort[:, 1]), 90.0) * np.array([-1.0, 1.0])))
    found = identify(panda.described, [replace(measured, effort=effort)])
    assert any(w.startswith("the torque of panda_joint2 is at its limit in 1") for w in found.warnings)
    error = np.abs(found.fit.beta - found.base.mapping @ panda.truth) / found.fit.deviation
    assert np.mean(error**2) < 2.0


def moved(arm: KnownArm, reach: float = 1.0, slower: float = 1.0) -> Measurement:
    """The measurement of a motion that is smaller, and slower."""
    time = arm.measured.time
    q, dq, ddq = periodic_motion(arm.described, time / slower, np.random.default_rng(5))
    middle = q.mean(axis=0)
    motion = np.stack([middle + reach * (q - middle), reach / slower * dq, reach / slower**2 * ddq])
    effort = regressor(arm.described.tree, *motion) @ arm.truth
    effort += arm.noise * np.random.default_rng(0).normal(size=effort.shape)
    return replace(arm.measured, position=STEP * np.round(motion[0] / STEP), effort=effort)


POOR: dict[str, tuple[Callable[[KnownArm], Measurement], tuple[str, ...]]] = {
    "1.5 s": (lambda arm: arm.measured.between(0.0, 0.05), ("no piece without gaps is longer than 2 s",)),
    "2.5 s": (lambda arm: arm.measured.between(0.0, 0.08), ("2.4 s of motion are too short", "record 20 s or more")),
    "3 s": (lambda arm: arm.measured.between(0.0, 0.1), ("s of motion remain after the filter; record at least 20 s",)),
    "small": (lambda arm: moved(arm, 0.1), ("joint4 lacks different postures for gravity (it covers 0.13 rad",)),
    "slow": (
        lambda arm: moved(arm, slower=10.0),
        (
            "joint4 lacks a range of velocities for friction (0.034 to 0.055 rad/s",
            "acceleration for inertia (0.023 rad",
        ),
    ),
}


@pytest.mark.parametrize("poor", POOR)
def test_the_motion_that_is_missing_is_named_with_the_command_that_makes_it(panda: KnownArm, poor: str) -> None:
    spoil, told = POOR[poor]
    with pytest.raises(IdentificationError) as refused:
        identify(panda.described, [spoil(panda)], "my_arm")
    for text in (*told, "./pidtsm excite --robot my_arm --duration 60 --out motion.yaml makes such a motion"):
        assert text in str(refused.value)
    assert "another robot" not in str(refused.value)
    assert "positive definite" not in str(refused.value)


def test_a_poor_motion_that_says_something_is_used_and_named(panda: KnownArm) -> None:
    found = identify(panda.described, [panda.measured.between(0.0, 0.25)])
    assert found.warnings[0].startswith("the last fifth is too short")
    assert "s of motion remain after the filter; record at least 20 s" in found.warnings[1]
    assert found.warnings[2].startswith("what this motion does not show stays as the description has it; ./pidtsm")
