"""Identification finds known parameters, and states what it does not know."""

from dataclasses import replace

import numpy as np
import pytest
from support.knownarm import KnownArm, known_arm

from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.identification import Identification, IdentificationError, identify
from pidtsm_core.identification.least_squares import motion_regressor
from pidtsm_core.identification.measurement import Measurement, filtered
from pidtsm_core.identification.pseudo_inertia import is_consistent
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.tree.unit_forces import LINK


@pytest.fixture(scope="module", params=["panda", "two_link"])
def known(request: pytest.FixtureRequest) -> KnownArm:
    found: KnownArm = request.getfixturevalue(request.param)
    return found


@pytest.fixture(scope="module")
def found(known: KnownArm) -> Identification:
    return identify(known.described, [known.measured])


def test_the_intervals_contain_the_truth_as_often_as_they_say(known: KnownArm, found: Identification) -> None:
    error = np.abs(found.fit.beta - found.base.mapping @ known.truth)
    assert np.mean(error < found.fit.half_interval) > 0.85
    assert np.mean((error / found.fit.deviation) ** 2) < 2.0


def test_intervals_of_a_short_motion_count_the_noise_that_the_estimates_absorb() -> None:
    arms = [known_arm("panda", seed, duration=15.0) for seed in range(4)]
    fits = [(arm, identify(arm.described, [arm.measured])) for arm in arms]
    ratios = [(found.fit.beta - found.base.mapping @ arm.truth) / found.fit.deviation for arm, found in fits]
    # By the residuals alone, 1.26.
    assert np.sqrt(np.mean(np.square(ratios))) < 1.08


def test_the_torque_on_data_kept_apart_is_predicted_as_well_as_by_the_truth(
    known: KnownArm, found: Identification
) -> None:
    check = found.check
    pieces = filtered(known.measured.between(0.8, 1.0), found.cutoff, found.fit.delay)
    true = np.concatenate([motion_regressor(known.described.tree, piece.motion) @ known.truth for piece in pieces])
    before, after, least = check.error(check.before), check.error(check.after), check.error(true)
    assert np.mean(after / least) < 1.15
    assert (before > 3.0 * after).all()
    assert found.warnings == ()


def test_the_links_are_possible_bodies_and_the_friction_resists(known: KnownArm, found: Identification) -> None:
    joints = len(known.described.joints)
    assert all(is_consistent(link) for link in found.parameters[: 10 * joints].reshape(joints, 10))
    assert (found.parameters[10 * joints : 13 * joints] >= 0.0).all()


def test_the_corrected_urdf_has_the_identified_parameters(known: KnownArm, found: Identification) -> None:
    again = read_description(corrected_urdf(known.described, found.parameters))
    joints = len(again.joints)
    read = described_parameters(again.tree, again.damping, again.friction)
    np.testing.assert_allclose(read[: 13 * joints], found.parameters[: 13 * joints], atol=1e-7)


def test_a_torque_that_is_late_is_found_to_be_late(two_link: KnownArm) -> None:
    measured, late = two_link.measured, 3
    delayed = replace(
        measured, time=measured.time[late:], position=measured.position[late:], effort=measured.effort[:-late]
    )
    fit = identify(two_link.described, [delayed]).fit
    assert fit.delay == pytest.approx(late * measured.period, abs=4.0 * fit.delay_deviation)
    assert fit.delay_deviation < 2e-3


def hardly_moved(known: KnownArm) -> Measurement:
    """The heavier of two links hardly moves."""
    state = np.random.default_rng(0).uniform(-0.2, 0.2, (3, 7500, 2))
    time = known.measured.time
    state[0] = np.stack([0.03 * np.sin(2.0 * time), np.sin(time)], axis=1)
    state[1] = np.stack([0.06 * np.cos(2.0 * time), np.cos(time)], axis=1)
    state[2] = np.stack([-0.12 * np.sin(2.0 * time), -np.sin(time)], axis=1)
    effort = regressor(known.described.tree, *state) @ known.truth
    effort += 0.5 * np.random.default_rng(1).normal(size=effort.shape)
    return replace(known.measured, position=state[0], effort=effort)


def test_directions_without_data_keep_the_description(two_link: KnownArm) -> None:
    found = identify(two_link.described, [hardly_moved(two_link)])
    assert found.undetermined
    before, after = found.base.mapping @ found.described, found.base.mapping @ found.parameters
    for i in found.undetermined:
        assert abs(after[i] - before[i]) < 2.0 * found.fit.deviation[i]


def test_rotors_that_are_known_otherwise_take_the_place_of_described_ones(two_link: KnownArm) -> None:
    rotors, of_rotors = np.array([0.2, 0.0]), slice(2 * LINK, 2 * LINK + 2)
    measured = hardly_moved(two_link)
    given, without = (identify(two_link.described, [measured], rotors=each) for each in (rotors, None))
    assert given.parameters[of_rotors][0] == pytest.approx(rotors[0], rel=0.1)
    assert without.parameters[of_rotors][0] != pytest.approx(rotors[0], rel=0.5), "the motion does not tell them"
    np.testing.assert_array_equal(given.described, without.described)


def test_two_recordings_say_more_than_one(two_link: KnownArm) -> None:
    other = known_arm("two_link", seed=0, duration=20.0)
    one = identify(two_link.described, [two_link.measured]).fit
    both = identify(two_link.described, [two_link.measured, other.measured]).fit
    assert np.mean(both.deviation / one.deviation) < 1.0


def test_a_recording_that_is_too_short_is_refused(two_link: KnownArm) -> None:
    with pytest.raises(IdentificationError, match="no piece without gaps is longer than 2 s"):
        identify(two_link.described, [two_link.measured.between(0.0, 0.05)])
