"""A payload is found in ten seconds of motion."""

from dataclasses import replace

import numpy as np
import pytest
from support.knownarm import KnownArm, known_arm

from pidtsm_core.arrays import Array
from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.identification import IdentificationError
from pidtsm_core.identification.payload import identify_payload
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.robots import Description
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree.unit_forces import LINK
from pidtsm_core.robots.tree_robot import tree_robot

CARRIED = Payload(1.5, np.array([0.02, -0.03, 0.08]), np.diag([0.004, 0.003, 0.002]))


def identified(known: KnownArm) -> Description:
    """A description that is right, but for offsets."""
    return read_description(corrected_urdf(known.described, known.truth))


def with_payload(known: KnownArm, arm: Description, payload: Payload) -> Array:
    """The additional torques of a payload during the first ten seconds, shape (samples, joints)."""
    robot = tree_robot("arm", arm.text)
    loaded = arm.tree.copy()
    robot.load(loaded, payload)
    none = np.zeros(len(arm.joints))
    q = known.measured.position
    time = known.measured.time
    dq = np.gradient(q, time, axis=0)
    ddq = np.gradient(dq, time, axis=0)
    added = described_parameters(loaded, none, none) - described_parameters(arm.tree, none, none)
    return np.asarray(regressor(arm.tree, q, dq, ddq)[..., : LINK * none.size] @ added[: LINK * none.size])


@pytest.fixture(scope="module")
def fine() -> KnownArm:
    """Encoders so fine that their second differences are accelerations."""
    return known_arm("panda", duration=12.0, step=1e-9)


def test_mass_centre_and_inertia_are_found_with_intervals(fine: KnownArm) -> None:
    arm = identified(fine)
    measured = replace(fine.measured, effort=fine.measured.effort + with_payload(fine, arm, CARRIED))
    found = identify_payload(arm, measured)
    assert found.mass == pytest.approx(CARRIED.mass, rel=0.02)
    assert np.linalg.norm(found.center_of_mass - CARRIED.center_of_mass) < 0.005
    assert abs(found.mass - CARRIED.mass) < 2.0 * found.mass_interval
    assert (np.abs(found.center_of_mass - CARRIED.center_of_mass) < 2.0 * found.center_interval).all()
    moments = np.array([0.004, 0.003, 0.002, 0.0, 0.0, 0.0])
    assert (np.abs(found.inertia - moments) < 2.0 * found.inertia_interval).all()
    assert found.warnings == ()


def test_an_empty_gripper_weighs_nothing(fine: KnownArm) -> None:
    found = identify_payload(identified(fine), fine.measured)
    assert found.mass < 0.05


def test_an_arm_at_rest_shows_no_payload(fine: KnownArm) -> None:
    still = replace(fine.measured, position=0.0 * fine.measured.position)
    with pytest.raises(IdentificationError, match="stands still"):
        identify_payload(identified(fine), still)
