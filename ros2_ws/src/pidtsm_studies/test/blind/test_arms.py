"""Blind arms follow from their seed, and their truth can be sealed and opened."""

from pathlib import Path

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_studies.blind.arms import blind_arm
from pidtsm_studies.blind.faults import FAULTS
from pidtsm_studies.blind.seal import SEALED, opened, seal
from pidtsm_studies.diagnosis.causes import NAMES, Cause


def test_the_same_seed_makes_the_same_arm_and_another_seed_another_one(tmp_path: Path) -> None:
    arms = [blind_arm(seed, tmp_path, duration=3.0) for seed in (11, 11, 12)]
    assert arms[0].experiment.values == arms[1].experiment.values
    assert arms[0].truth == arms[1].truth
    assert arms[0].experiment.values != arms[2].experiment.values


def test_seeds_make_arms_without_faults_with_one_and_with_two(tmp_path: Path) -> None:
    counts = {len(blind_arm(seed, tmp_path, "scara", duration=3.0).truth) for seed in range(12)}
    assert counts == {0, 1, 2}


def test_every_cause_can_be_planted_and_has_a_name() -> None:
    assert set(FAULTS) == set(Cause) == set(NAMES)


def test_an_arm_without_a_urdf_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="two_link has no URDF"):
        blind_arm(1, tmp_path, "two_link")


def test_the_seal_hides_the_truth_and_opens_to_it(tmp_path: Path) -> None:
    made = blind_arm(5, tmp_path, "z1", [Cause.WRONG_SIGN], duration=3.0)
    assert opened(tmp_path) is None
    seal(made.truth, tmp_path)
    assert "sign" not in (tmp_path / SEALED).read_text(encoding="utf-8")
    (fault,) = opened(tmp_path) or [{}]
    assert (fault["cause"], tuple(fault["joints"])) == ("wrong_sign", made.truth[0].joints)
    (tmp_path / SEALED).write_text("nothing", encoding="utf-8")
    with pytest.raises(UsageError, match="damaged"):
        opened(tmp_path)
