"""Slow motion that does not follow the model of friction is found and left out."""

from dataclasses import replace

import numpy as np
import pytest
from support.knownarm import KnownArm, periodic_motion

from pidtsm_core.identification.identification import identify
from pidtsm_core.identification.measurement import FAST
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.robots.tree.unit_forces import LINK

CREEP = 0.08
"""rad/s; the last joint creeps up to about three times as fast."""


@pytest.mark.parametrize("name", ["panda", "two_link"])
def test_a_joint_that_creeps_is_named_and_its_friction_is_found(request: pytest.FixtureRequest, name: str) -> None:
    known: KnownArm = request.getfixturevalue(name)
    arm, time = known.described, known.measured.time
    joints = len(arm.joints)
    q, dq, ddq = periodic_motion(arm, time, np.random.default_rng(0))
    full = regressor(arm.tree, q, dq, ddq)
    coulomb = (LINK + 2) * joints + joints - 1
    full[:, -1, coulomb] = np.tanh(dq[:, -1] / CREEP)
    measured = replace(known.measured, position=q, effort=full @ known.truth)
    found = identify(arm, [measured])
    friction = slice((LINK + 1) * joints, (LINK + 3) * joints)
    np.testing.assert_allclose(found.parameters[friction], known.truth[friction], rtol=0.02)
    assert [note.split(":")[0] for note in found.notes if "friction does not follow" in note] == [arm.joints[-1]]


def test_with_noise_no_motion_is_left_out_that_follows_the_model(panda: KnownArm) -> None:
    found = identify(panda.described, [panda.measured])
    assert not any("friction" in note for note in found.notes)
    assert found.check.usable[np.abs(found.check.motion.velocity) > 2.0 * FAST].mean() > 0.8
