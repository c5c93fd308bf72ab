"""The Stribeck curve."""

import numpy as np
import pytest

from pidtsm_core.parameters import Array, ParameterError, resolve
from pidtsm_core.simulation.friction import PARAMETERS, add_friction, check_friction, friction_config

COULOMB, STATIC, STRIBECK, VISCOUS = 3.0, 5.0, 0.05, 0.7
HEAVY = np.full(2, np.inf)


def friction(velocities: Array) -> Array:
    """Friction torque against the velocity of the first of two joints, N m."""
    settings = {
        "friction.coulomb": [COULOMB, 0.0],
        "friction.static": [STATIC, 0.0],
        "friction.stribeck_velocity": STRIBECK,
        "friction.viscous": [VISCOUS, 0.0],
    }
    config = friction_config(resolve(lambda _: PARAMETERS, settings, 2), HEAVY, 0.001)
    torque = np.zeros((len(velocities), 2))
    for k, velocity in enumerate(velocities):
        add_friction(config, np.array([velocity, velocity]), torque[k])
    assert not torque[:, 1].any()
    return -torque[:, 0]


def test_fast_joints_have_coulomb_and_viscous_friction() -> None:
    fast = np.array([0.5, 1.0, 4.0])
    np.testing.assert_allclose(friction(fast), COULOMB + VISCOUS * fast, rtol=1e-9)


def test_friction_is_odd_smooth_and_highest_where_a_joint_breaks_away() -> None:
    velocity = np.linspace(0.0, 0.5, 5001)
    torque = friction(velocity)
    assert torque[0] == 0.0
    np.testing.assert_array_equal(friction(-velocity), -torque)
    peak = velocity[np.argmax(torque)]
    assert 0.0 < peak < STRIBECK
    assert 0.85 * STATIC < torque.max() < STATIC + VISCOUS * peak
    # No jump: the slope at rest is that of tanh.
    assert np.diff(torque).max() <= STATIC / (STRIBECK / 10.0) * velocity[1] * 1.01


def test_static_friction_below_coulombs_does_not_count() -> None:
    values = resolve(lambda _: PARAMETERS, {"friction.coulomb": 2.0, "friction.static": 1.0}, 2)
    assert friction_config(values, HEAVY, 0.001).excess.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", [p.name for p in PARAMETERS if p.name != "friction.stribeck_velocity"])
def test_friction_is_off_by_default_and_on_with_any_of_its_parts(name: str) -> None:
    assert friction_config(resolve(lambda _: PARAMETERS, {}, 2), HEAVY, 0.001).none
    assert not friction_config(resolve(lambda _: PARAMETERS, {name: [0.0, 1.0]}, 2), HEAVY, 0.001).none


def test_friction_of_a_light_joint_rises_no_steeper_than_runge_kutta_can_follow() -> None:
    values = resolve(lambda _: PARAMETERS, {"friction.coulomb": 2.0}, 2)
    config = friction_config(values, np.array([5.0, 0.01]), 0.001)
    assert config.stribeck_velocity[0] == 0.05
    torque = np.zeros(2)
    add_friction(config, np.full(2, 1e-6), torque)
    slopes = -torque / 1e-6
    assert slopes[0] == pytest.approx(2.0 / 0.005, rel=1e-3)
    assert slopes[1] * 0.001 / 0.01 == pytest.approx(1.0, rel=1e-3)


def test_viscous_friction_that_runge_kutta_cannot_follow_is_refused_at_the_start_and_limited_in_between() -> None:
    values = resolve(lambda _: PARAMETERS, {"friction.viscous": 2.0}, 2)
    inertia = np.array([5.0, 0.001])
    with pytest.raises(ParameterError, match=r"stop elbow, whose inertia is 0\.001 kg m.*set robot\.armature"):
        check_friction({**values, "joints": ("shoulder", "elbow")}, inertia, 0.001)
    assert friction_config(values, inertia, 0.001).viscous.tolist() == [2.0, 1.0]
