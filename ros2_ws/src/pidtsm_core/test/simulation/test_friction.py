"""The Stribeck curve."""

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.simulation.friction import (
    PARAMETERS,
    FrictionConfig,
    add_friction,
    check_friction,
    friction_config,
)

COULOMB, STATIC, STRIBECK, VISCOUS = 3.0, 5.0, 0.05, 0.7


def of_last(arm: Arm, value: float) -> list[float]:
    return [*[0.0] * (arm.joints - 1), value]


def config_of(arm: Arm, settings: dict[str, object], inertia: float = np.inf) -> FrictionConfig:
    """Configuration for joints with this inertia."""
    values = resolve(lambda _: PARAMETERS, settings, arm.joints)
    return friction_config(values, np.full(arm.joints, inertia), 0.001)


def friction(arm: Arm, velocities: Array) -> Array:
    """Friction torque against the velocity of the last joint, N m; the others have none."""
    settings: dict[str, object] = {
        "friction.coulomb": of_last(arm, COULOMB),
        "friction.static": of_last(arm, STATIC),
        "friction.stribeck_velocity": STRIBECK,
        "friction.viscous": of_last(arm, VISCOUS),
    }
    config = config_of(arm, settings)
    torque = np.zeros((len(velocities), arm.joints))
    for k, velocity in enumerate(velocities):
        add_friction(config, np.full(arm.joints, velocity), torque[k])
    assert not torque[:, :-1].any()
    return -torque[:, -1]


def test_fast_joints_have_coulomb_and_viscous_friction(arm: Arm) -> None:
    fast = np.array([0.5, 1.0, 4.0])
    np.testing.assert_allclose(friction(arm, fast), COULOMB + VISCOUS * fast, rtol=1e-9)


def test_friction_is_odd_smooth_and_highest_where_a_joint_breaks_away(arm: Arm) -> None:
    velocity = np.linspace(0.0, 0.5, 5001)
    torque = friction(arm, velocity)
    assert torque[0] == 0.0
    np.testing.assert_array_equal(friction(arm, -velocity), -torque)
    peak = velocity[np.argmax(torque)]
    assert 0.0 < peak < STRIBECK
    assert 0.85 * STATIC < torque.max() < STATIC + VISCOUS * peak
    # No jump: the slope at rest is that of tanh.
    assert np.diff(torque).max() <= STATIC / (STRIBECK / 10.0) * velocity[1] * 1.01


def test_static_friction_below_coulombs_does_not_count(arm: Arm) -> None:
    assert not config_of(arm, {"friction.coulomb": 2.0, "friction.static": 1.0}).excess.any()


@pytest.mark.parametrize("name", [p.name for p in PARAMETERS if p.name != "friction.stribeck_velocity"])
def test_friction_is_off_by_default_and_on_with_any_of_its_parts(arm: Arm, name: str) -> None:
    assert config_of(arm, {}).none
    assert not config_of(arm, {name: of_last(arm, 1.0)}).none


def inertias(arm: Arm, last: float) -> Array:
    return np.array([*[5.0] * (arm.joints - 1), last])


def test_friction_of_a_light_joint_rises_no_steeper_than_runge_kutta_can_follow(arm: Arm) -> None:
    values = resolve(lambda _: PARAMETERS, {"friction.coulomb": 2.0}, arm.joints)
    config = friction_config(values, inertias(arm, 0.01), 0.001)
    assert (config.stribeck_velocity[:-1] == 0.05).all()
    torque = np.zeros(arm.joints)
    add_friction(config, np.full(arm.joints, 1e-6), torque)
    slopes = -torque / 1e-6
    np.testing.assert_allclose(slopes[:-1], 2.0 / 0.005, rtol=1e-3)
    assert slopes[-1] * 0.001 / 0.01 == pytest.approx(1.0, rel=1e-3)


def test_viscous_friction_that_runge_kutta_cannot_follow_is_refused_at_the_start_and_limited_in_between(
    arm: Arm,
) -> None:
    values, inertia = resolve(lambda _: PARAMETERS, {"friction.viscous": 2.0}, arm.joints), inertias(arm, 0.001)
    with pytest.raises(ParameterError, match=rf"stop {arm.names[-1]}, whose inertia is 0\.001 kg m.*set robot\.arm"):
        check_friction({**values, "joints": tuple(arm.names)}, inertia, 0.001)
    assert friction_config(values, inertia, 0.001).viscous.tolist() == [*[2.0] * (arm.joints - 1), 1.0]
