"""One control period: limits, saturation, anti-windup, irregular time, reset."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.pairs import paired
from support.testarms import ARMS, Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.state import arrays_of
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS, STATE_SLOTS, Interval, advance, command, make_law
from pidtsm_core.parameters import ParameterError, as_float
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Adaptation, Signal

PROPERTY = settings(deadline=None, max_examples=12)
SENSED = [e.name for e in ESTIMATORS.members if not e.needs_truth]
DEFAULTS = {"law.name": "piddtsm", "estimator.name": "filtered_difference"}
# The defaults, and each part alone with the others at their defaults.
PARTS = [DEFAULTS] + [
    {**DEFAULTS, family: name}
    for family, names in (("law.name", LAWS.names), ("estimator.name", SENSED))
    for name in names
    if name != DEFAULTS[family]
]
# Every part and every arm: what an arm does to a tick does not depend on the part.
EACH = paired("parts,arm", PARTS, ARMS)
DT = 0.001
ERRORS = [Signal.POSITION_ERROR, Signal.SLIDING_VARIABLE, Signal.MANIFOLD_VARIABLE]
OF_LAW = [Signal.SLIDING_VARIABLE, Signal.MANIFOLD_VARIABLE, Signal.ADAPTIVE_GAIN, Signal.SWITCHING_TERM]
UNLIMITED = {"limits__effort": 1e12}


def controller_of(arm: Arm, parts: dict[str, str], **changes: object) -> Controller:
    """A controller; parameter names with two underscores instead of the dot."""
    return Controller(arm.values(controller_schema, {**parts, **dotted(changes)}))


def walk(joints: int, seed: int, samples: int = 100, size: float = 0.01) -> tuple[Array, Array]:
    """Random walks of measured positions and desired motions, shapes (samples, joints), (samples, 3, joints)."""
    random = np.random.default_rng(seed)
    return (
        np.cumsum(random.normal(scale=size, size=(samples, joints)), axis=0),
        np.cumsum(random.normal(scale=size, size=(samples, 3, joints)), axis=0),
    )


def run(controller: Controller, positions: Array, desired: Array, dts: Array | None = None) -> Array:
    dts = np.full(len(positions), DT) if dts is None else dts
    return np.array(
        [
            controller.tick(q, d, float(dt) if k else 0.0).copy()
            for k, (q, d, dt) in enumerate(zip(positions, desired, dts, strict=True))
        ]
    )


@EACH
@PROPERTY
@given(data=st.data(), size=st.sampled_from([1e-6, 1.0, 1e3, 1e6]))
def test_the_torque_is_finite_and_within_its_limits_whatever_comes_in(
    arm: Arm, parts: dict[str, str], data: st.DataObject, size: float
) -> None:
    controller = controller_of(arm, parts)
    limit = controller.config.limits.effort
    values = st.floats(-size, size)
    for k in range(5):
        numbers = data.draw(st.lists(values, min_size=4 * controller.joints, max_size=4 * controller.joints))
        q, *desired = np.array(numbers).reshape(4, -1)
        dt = data.draw(st.floats(1e-5, 0.1)) if k else 0.0
        signals = controller.tick(q, np.array(desired), dt)
        assert np.isfinite(signals).all()
        assert (np.abs(signals[Signal.EFFORT]) <= limit).all()
        np.testing.assert_array_equal(signals[Signal.SATURATED], np.abs(signals[Signal.EFFORT]) == limit)


@EACH
@PROPERTY
@given(numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=16, max_size=16))
@example(numbers=[0.0, 1e307, 0.0])
@example(numbers=[0.0, 1e160, 0.0])
def test_the_torque_is_finite_for_every_finite_position_and_afterwards(
    arm: Arm, parts: dict[str, str], numbers: list[float]
) -> None:
    controller = controller_of(arm, parts)
    limit = controller.config.limits.effort
    rest = np.zeros((3, controller.joints))
    for k, number in enumerate([*numbers, *[0.0] * 10]):
        effort = controller.tick(np.full(controller.joints, number), rest, DT if k else 0.0)[Signal.EFFORT]
        assert (np.abs(effort) <= limit).all()
    assert np.isfinite(controller.state.law).all()


@EACH
def test_errors_are_estimate_minus_desired(arm: Arm, parts: dict[str, str]) -> None:
    controller = controller_of(arm, parts)
    positions, desired = walk(controller.joints, 1)
    signals = run(controller, positions, desired)
    np.testing.assert_array_equal(signals[:, Signal.POSITION_ERROR], signals[:, Signal.POSITION] - desired[:, 0])
    np.testing.assert_array_equal(signals[:, Signal.VELOCITY_ERROR], signals[:, Signal.VELOCITY] - desired[:, 1])
    assert signals.shape == (len(positions), len(Signal), controller.joints)


@paired("parts,arm", [p for p in PARTS if LAWS[p["law.name"]].softens], ARMS)
def test_torque_is_the_inverse_dynamics_of_the_commanded_acceleration(arm: Arm, parts: dict[str, str]) -> None:
    controller = controller_of(arm, parts, **UNLIMITED, compensation__coulomb=0.0, compensation__viscous=0.0)
    for y in run(controller, *walk(controller.joints, 2)):
        expected = np.zeros((1, controller.joints))
        inverse_dynamics(
            controller.config.model,
            y[Signal.POSITION],
            y[Signal.VELOCITY],
            y[Signal.ACCELERATION_COMMAND][np.newaxis],
            expected,
        )
        np.testing.assert_array_equal(y[Signal.EFFORT], expected[0])
        assert not y[Signal.SATURATED].any()


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if not law.of_arm])
def test_every_joint_has_the_law_of_a_single_joint_with_its_own_gains(arm: Arm, law: str) -> None:
    """So what holds for the law of one joint holds for each joint of an arm, whatever the others do."""
    values = arm.values(controller_schema, {"law.name": law, "limits.effort": 1e12})
    for parameter in controller_schema({**arm.settings, "law.name": law}):
        if parameter.name.startswith("law.") and parameter.per_joint:
            values[parameter.name] = tuple(as_float(parameter.default) * share for share in arm.spread(0.8, 1.0))
    controller, (positions, desired) = Controller(values), walk(arm.joints, 9, samples=30)
    signals = run(controller, positions, desired)
    made = make_law(LAWS[law], values, arm.joints)
    for j in range(arm.joints):
        x = np.zeros(STATE_SLOTS)
        for k, y in enumerate(signals[:, :, j]):
            if k:
                e, s, sigma = signals[k - 1, ERRORS, j]
                advance(made, j, e, s, sigma, x, Interval(DT, False, Adaptation.NORMAL.value))
            e, de, dde = y[Signal.POSITION_ERROR], y[Signal.VELOCITY_ERROR], y[Signal.ACCELERATION] - desired[k, 2, j]
            a_cmd, _, *rest = command(made, j, e, de, dde, desired[k, 2, j], x, DT if k else 0.0)
            assert rest == y[OF_LAW].tolist()
            if LAWS[law].uses_model:
                assert a_cmd == y[Signal.ACCELERATION_COMMAND]


def test_torque_is_the_equivalent_one_and_that_of_the_switching_term(arm: Arm) -> None:
    """Eqs. (15), (16), (20): tau = -phi^-1 (tau_eq - tau_sw) with phi^-1 = H / Kd."""
    kd = np.array(arm.spread(0.4, 0.7))
    controller = arm.controller(**UNLIMITED, law__kd=kd.tolist())
    signals = run(controller, *walk(arm.joints, 3))
    assert np.abs(signals[-1, Signal.SWITCHING_TERM]).min() > 0.0
    for y in signals:
        q = y[Signal.POSITION]
        switching = arm.effort(q, ddq=y[Signal.SWITCHING_TERM] / kd) - arm.effort(q)
        scale = np.abs(y[Signal.EFFORT]).max() + np.abs(switching).max()
        np.testing.assert_allclose(
            y[Signal.EFFORT], y[Signal.EQUIVALENT_EFFORT] + switching, rtol=0, atol=1e-11 * scale
        )


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_saturation_is_reported_per_joint(arm: Arm, direction: float) -> None:
    for joint in range(arm.joints):
        limits = np.full(arm.joints, 1e6)
        limits[joint] = 0.1 * arm.limits[joint]
        desired = np.zeros((3, arm.joints))
        desired[0, joint] = direction * 2.0
        signals = arm.controller(limits__effort=limits.tolist()).tick(np.zeros(arm.joints), desired, 0.0)
        assert signals[Signal.EFFORT, joint] == direction * limits[joint]
        assert signals[Signal.SATURATED].tolist() == [float(j == joint) for j in range(arm.joints)]


# Columns of the law's state: int s, int e.
INTEGRALS = slice(0, 2)


@pytest.mark.parametrize("frozen", [0, -1], ids=["first joint", "last joint"])
def test_conditional_anti_windup_freezes_the_saturated_joint_only(arm: Arm, frozen: int) -> None:
    desired, positions, limits = np.full((30, 3, arm.joints), 0.5), np.zeros((30, arm.joints)), np.full(arm.joints, 1e9)
    limits[frozen] = 1e-3
    others = np.delete(np.arange(arm.joints), frozen)
    controller = arm.controller(limits__effort=limits.tolist(), law__anti_windup="conditional")
    signals = run(controller, positions, desired)
    assert (signals[:, Signal.SATURATED, frozen] == 1.0).all()
    assert not signals[:, Signal.SATURATED, others].any()
    assert not controller.state.law[frozen, INTEGRALS].any()
    assert not signals[:, Signal.ADAPTIVE_GAIN, frozen].any()
    assert (controller.state.law[others, INTEGRALS] != 0.0).all()
    assert (signals[-1, Signal.ADAPTIVE_GAIN, others] > 0.0).all()
    # The other joints behave as if none were limited.
    unlimited = run(arm.controller(limits__effort=1e9), positions, desired)
    for signal in (Signal.MANIFOLD_VARIABLE, Signal.ADAPTIVE_GAIN, Signal.ACCELERATION_COMMAND):
        np.testing.assert_array_equal(signals[:, signal, others], unlimited[:, signal, others])


def test_without_anti_windup_saturation_changes_nothing_but_the_torque(arm: Arm) -> None:
    positions, desired = walk(arm.joints, 4, size=0.05)
    tight = run(arm.controller(limits__effort=1e-3, law__anti_windup="none"), positions, desired)
    loose = run(arm.controller(**UNLIMITED, law__anti_windup="none"), positions, desired)
    same = [s for s in Signal if s not in (Signal.EFFORT, Signal.SATURATED)]
    np.testing.assert_array_equal(tight[:, same], loose[:, same])
    assert (tight[:, Signal.SATURATED] == 1.0).all()


def test_irregular_periods_integrate_what_was_held_over_them(arm: Arm) -> None:
    controller = arm.controller(**UNLIMITED)
    positions, desired = walk(arm.joints, 5)
    dts = np.random.default_rng(6).uniform(1e-4, 0.02, len(positions))
    signals = run(controller, positions, desired, dts)
    assert np.isfinite(signals).all()
    for column, row in enumerate((Signal.SLIDING_VARIABLE, Signal.POSITION_ERROR)):
        expected = (signals[:-1, row] * dts[1:, None]).sum(axis=0)
        np.testing.assert_allclose(controller.state.law[:, column], expected, rtol=1e-10)


@EACH
def test_a_run_after_reset_is_bit_for_bit_the_first(arm: Arm, parts: dict[str, str]) -> None:
    controller = controller_of(arm, parts)
    positions, desired = walk(controller.joints, 7)
    first = run(controller, positions, desired)
    controller.reset()
    kept = controller.state.measured, controller.state.received
    reset = [array for array in arrays_of(controller.state) if not any(array is each for each in kept)]
    assert not any(array.any() for array in reset)
    assert run(controller, positions, desired).tobytes() == first.tobytes()
    assert run(controller_of(arm, parts), positions, desired).tobytes() == first.tobytes()


@EACH
def test_new_parameters_keep_the_state(arm: Arm, parts: dict[str, str]) -> None:
    positions, desired = walk(arm.joints, 8)
    undisturbed, changed = controller_of(arm, parts), controller_of(arm, parts)
    expected = run(undisturbed, positions, desired)
    run(changed, positions[:50], desired[:50])
    kept = [array.copy() for array in arrays_of(changed.state)]
    changed.set_parameters(arm.values(controller_schema, {**parts, "limits.effort": 1e-3}))
    for before, now in zip(kept, arrays_of(changed.state), strict=True):
        np.testing.assert_array_equal(now, before)
    # With the previous parameters again, the rest is that of a run without changes.
    changed.set_parameters(arm.values(controller_schema, parts))
    rest = [changed.tick(q, d, DT).copy() for q, d in zip(positions[50:], desired[50:], strict=True)]
    np.testing.assert_array_equal(np.array(rest), expected[50:])


def test_new_gains_act_from_the_next_tick_on(arm: Arm) -> None:
    controller = arm.controller(limits__effort=1e9)
    desired = np.full((3, arm.joints), 0.1)
    before = controller.tick(np.zeros(arm.joints), desired, 0.0)[Signal.SLIDING_VARIABLE].copy()
    more = np.array(arm.spread(1.0, 2.0))
    controller.set_parameters(arm.values(controller_schema, {"limits.effort": 1e9, "law.k2": (0.5 + more).tolist()}))
    after = controller.tick(np.zeros(arm.joints), desired, DT)[Signal.SLIDING_VARIABLE]
    # e = -0.1, and k2 was 0.5.
    np.testing.assert_allclose(after - before, -0.1 * more, rtol=1e-12)


def test_inputs_are_not_changed(arm: Arm) -> None:
    q, desired = np.array(arm.start), np.arange(3.0 * arm.joints).reshape(3, -1)
    kept = q.copy(), desired.copy()
    arm.controller().tick(q, desired, 0.0)
    np.testing.assert_array_equal(q, kept[0])
    np.testing.assert_array_equal(desired, kept[1])


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if law.uses_model])
def test_a_rejected_disturbance_is_subtracted_from_the_commanded_acceleration(arm: Arm, law: str) -> None:
    observed = {"law.name": law, "estimator.name": "extended_state_observer"}
    without, rejecting = (
        controller_of(arm, observed, **UNLIMITED, law__disturbance_rejection=rejects) for rejects in (False, True)
    )
    positions, desired = walk(arm.joints, 11, samples=2)
    for controller in (without, rejecting):
        controller.tick(positions[0], desired[0], 0.0)
        controller.state.estimator[:, 2] = arm.spread(-3.0, 3.0)
        controller.tick(positions[1], desired[1], DT)
    disturbance = rejecting.state.estimator[:, 2]
    np.testing.assert_array_equal(disturbance, without.state.estimator[:, 2])
    np.testing.assert_allclose(
        rejecting.state.signals[Signal.ACCELERATION_COMMAND],
        without.state.signals[Signal.ACCELERATION_COMMAND] - disturbance,
        rtol=1e-12,
    )


def test_friction_is_compensated_at_the_desired_velocity_and_unknown_to_the_observer(arm: Arm) -> None:
    coulomb, viscous = arm.spread(2.0, 0.5), arm.spread(0.3, 0.1)
    observed = {"estimator.name": "extended_state_observer"}
    without = controller_of(arm, observed, **UNLIMITED, compensation__coulomb=0.0, compensation__viscous=0.0)
    compensating = controller_of(
        arm, observed, **UNLIMITED, compensation__coulomb=coulomb, compensation__viscous=viscous
    )
    desired = np.array([arm.start, np.resize([0.5, -1.5], arm.joints), np.zeros(arm.joints)])
    for k in range(3):
        for controller in (without, compensating):
            controller.tick(np.array(arm.start), desired, DT if k else 0.0)
        # The observer sees the torque that accelerates the arm, so both have the same estimates.
        efforts = [controller.state.signals[Signal.EFFORT] for controller in (compensating, without)]
        expected = np.sign(desired[1]) * coulomb + desired[1] * viscous
        np.testing.assert_allclose(efforts[0] - efforts[1], expected, rtol=1e-12, atol=1e-12 * np.abs(efforts).max())
        np.testing.assert_allclose(
            compensating.state.signals[: Signal.POSITION_ERROR],
            without.state.signals[: Signal.POSITION_ERROR],
            atol=1e-12,
        )


def test_rejection_needs_an_estimator_that_estimates_the_disturbance(arm: Arm) -> None:
    with pytest.raises(ParameterError, match=r"law\.disturbance_rejection: estimator\.name must be elastic_joint_obs"):
        arm.controller(estimator__name="filtered_difference", law__disturbance_rejection=True)
