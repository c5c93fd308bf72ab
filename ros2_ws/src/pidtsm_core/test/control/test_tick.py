"""One control period: limits, saturation, anti-windup, irregular time, reset."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Array, ParameterError, resolve
from pidtsm_core.robots import inverse_dynamics, robot_joints
from pidtsm_core.signals import Signal

PROPERTY = settings(deadline=None, max_examples=40)
ROBOTS = ("two_link", "scara", "panda")
SENSED = [e.name for e in ESTIMATORS.members if not e.needs_truth]
DEFAULTS = {"law.name": "piddtsm", "estimator.name": "filtered_difference", "robot.description": "two_link"}
# The defaults, and each part alone with the others at their defaults.
PARTS = [DEFAULTS] + [
    {**DEFAULTS, family: name}
    for family, names in (("law.name", LAWS.names), ("estimator.name", SENSED), ("robot.description", ROBOTS))
    for name in names
    if name != DEFAULTS[family]
]
EACH = pytest.mark.parametrize("parts", PARTS, ids=lambda p: "-".join(p.values()))
DT = 0.001


def controller_of(parts: dict[str, str] | None = None, **changes: object) -> Controller:
    """A controller; parameter names with two underscores instead of the dot."""
    chosen = {**(parts or {}), **{name.replace("__", "."): value for name, value in changes.items()}}
    return Controller(resolve(controller_schema, chosen, robot_joints(chosen)))


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


def inertia_times(controller: Controller, q: Array, x: Array) -> Array:
    """H(q) x, from two evaluations of the inverse dynamics."""
    accelerations, efforts = np.array([x, np.zeros(q.size)]), np.zeros((2, q.size))
    inverse_dynamics(controller.config.model, q, np.zeros(q.size), accelerations, efforts)
    return efforts[0] - efforts[1]


@EACH
@PROPERTY
@given(data=st.data(), size=st.sampled_from([1e-6, 1.0, 1e3, 1e6]))
def test_the_torque_is_finite_and_within_its_limits_whatever_comes_in(
    parts: dict[str, str], data: st.DataObject, size: float
) -> None:
    controller = controller_of(parts)
    limit = controller.config.effort_limit
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
def test_the_torque_is_finite_for_every_finite_position_and_afterwards(
    parts: dict[str, str], numbers: list[float]
) -> None:
    controller = controller_of(parts)
    limit = controller.config.effort_limit
    rest = np.zeros((3, controller.joints))
    for k, number in enumerate([*numbers, *[0.0] * 4]):
        effort = controller.tick(np.full(controller.joints, number), rest, DT if k else 0.0)[Signal.EFFORT]
        assert (np.abs(effort) <= limit).all()


@EACH
def test_errors_are_estimate_minus_desired(parts: dict[str, str]) -> None:
    controller = controller_of(parts)
    positions, desired = walk(controller.joints, 1)
    signals = run(controller, positions, desired)
    np.testing.assert_array_equal(signals[:, Signal.POSITION_ERROR], signals[:, Signal.POSITION] - desired[:, 0])
    np.testing.assert_array_equal(signals[:, Signal.VELOCITY_ERROR], signals[:, Signal.VELOCITY] - desired[:, 1])
    assert signals.shape == (len(positions), len(Signal), controller.joints)


@EACH
def test_torque_is_the_inverse_dynamics_of_the_commanded_acceleration(parts: dict[str, str]) -> None:
    controller = controller_of(parts, limits__effort=1e12, compensation__coulomb=0.0, compensation__viscous=0.0)
    if not controller.config.uses_model:
        pytest.skip("the law gives torques")
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


@pytest.mark.parametrize("robot", ROBOTS)
def test_torque_is_the_equivalent_one_and_that_of_the_switching_term(robot: str) -> None:
    """Eqs. (15), (16), (20): tau = -phi^-1 (tau_eq - tau_sw) with phi^-1 = H / Kd."""
    kd = 0.4
    controller = controller_of({"robot.description": robot}, limits__effort=1e12, law__kd=kd)
    signals = run(controller, *walk(controller.joints, 3))
    assert np.abs(signals[-1, Signal.SWITCHING_TERM]).min() > 0.0
    for y in signals:
        switching = inertia_times(controller, y[Signal.POSITION], y[Signal.SWITCHING_TERM] / kd)
        scale = np.abs(y[Signal.EFFORT]).max() + np.abs(switching).max()
        np.testing.assert_allclose(
            y[Signal.EFFORT], y[Signal.EQUIVALENT_EFFORT] + switching, rtol=0, atol=1e-11 * scale
        )


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_saturation_is_reported_per_joint(direction: float) -> None:
    controller = controller_of(limits__effort=(20.0, 1e6))
    desired = np.zeros((3, 2))
    desired[0] = direction * 2.0
    signals = controller.tick(np.zeros(2), desired, 0.0)
    assert signals[Signal.EFFORT, 0] == direction * 20.0
    assert signals[Signal.SATURATED].tolist() == [1.0, 0.0]
    assert abs(signals[Signal.EFFORT, 1]) < 1e6


# Columns of the law's state: int s, int e.
INTEGRALS = slice(0, 2)


@pytest.mark.parametrize(("limits", "frozen"), [((1e-3, 1e9), 0), ((1e9, 1e-3), 1)])
def test_conditional_anti_windup_freezes_the_saturated_joint_only(limits: tuple[float, float], frozen: int) -> None:
    desired = np.full((30, 3, 2), 0.5)
    positions = np.zeros((30, 2))
    controller = controller_of(limits__effort=limits, law__anti_windup="conditional")
    signals = run(controller, positions, desired)
    assert (signals[:, Signal.SATURATED, frozen] == 1.0).all()
    assert not signals[:, Signal.SATURATED, 1 - frozen].any()
    assert not controller.state.law[frozen, INTEGRALS].any()
    assert not signals[:, Signal.ADAPTIVE_GAIN, frozen].any()
    assert (controller.state.law[1 - frozen, INTEGRALS] != 0.0).all()
    assert signals[-1, Signal.ADAPTIVE_GAIN, 1 - frozen] > 0.0
    # The other joint behaves as if neither were limited.
    unlimited = run(controller_of(limits__effort=1e9), positions, desired)
    free = [Signal.MANIFOLD_VARIABLE, Signal.ADAPTIVE_GAIN, Signal.ACCELERATION_COMMAND]
    np.testing.assert_array_equal(signals[:, free, 1 - frozen], unlimited[:, free, 1 - frozen])


def test_without_anti_windup_saturation_changes_nothing_but_the_torque() -> None:
    positions, desired = walk(2, 4, size=0.05)
    tight = run(controller_of(limits__effort=1e-3, law__anti_windup="none"), positions, desired)
    loose = run(controller_of(limits__effort=1e12, law__anti_windup="none"), positions, desired)
    same = [s for s in Signal if s not in (Signal.EFFORT, Signal.SATURATED)]
    np.testing.assert_array_equal(tight[:, same], loose[:, same])
    assert (tight[:, Signal.SATURATED] == 1.0).all()


def test_irregular_periods_integrate_what_was_held_over_them() -> None:
    controller = controller_of(limits__effort=1e12)
    positions, desired = walk(2, 5)
    dts = np.random.default_rng(6).uniform(1e-4, 0.02, len(positions))
    signals = run(controller, positions, desired, dts)
    assert np.isfinite(signals).all()
    for column, row in enumerate((Signal.SLIDING_VARIABLE, Signal.POSITION_ERROR)):
        expected = (signals[:-1, row] * dts[1:, None]).sum(axis=0)
        np.testing.assert_allclose(controller.state.law[:, column], expected, rtol=1e-10)


@EACH
def test_a_run_after_reset_is_bit_for_bit_the_first(parts: dict[str, str]) -> None:
    controller = controller_of(parts)
    positions, desired = walk(controller.joints, 7)
    first = run(controller, positions, desired)
    controller.reset()
    assert not any(array.any() for array in controller.state)
    assert run(controller, positions, desired).tobytes() == first.tobytes()
    assert run(controller_of(parts), positions, desired).tobytes() == first.tobytes()


@EACH
def test_new_parameters_keep_the_state(parts: dict[str, str]) -> None:
    positions, desired = walk(robot_joints(dict(parts)), 8)
    undisturbed, changed = controller_of(parts), controller_of(parts)
    expected = run(undisturbed, positions, desired)
    run(changed, positions[:50], desired[:50])
    kept = [array.copy() for array in changed.state]
    changed.set_parameters(resolve(controller_schema, {**parts, "limits.effort": 1e-3}, changed.joints))
    for before, now in zip(kept, changed.state, strict=True):
        np.testing.assert_array_equal(now, before)
    # With the previous parameters again, the rest is that of a run without changes.
    changed.set_parameters(resolve(controller_schema, parts, changed.joints))
    rest = [changed.tick(q, d, DT).copy() for q, d in zip(positions[50:], desired[50:], strict=True)]
    np.testing.assert_array_equal(np.array(rest), expected[50:])


def test_new_gains_act_from_the_next_tick_on() -> None:
    controller = controller_of(limits__effort=1e9)
    desired = np.full((3, 2), 0.1)
    before = controller.tick(np.zeros(2), desired, 0.0)[Signal.SLIDING_VARIABLE].copy()
    values = resolve(controller_schema, {"limits.effort": 1e9, "law.k2": 1.5}, 2)
    controller.set_parameters(values)
    after = controller.tick(np.zeros(2), desired, DT)[Signal.SLIDING_VARIABLE]
    # e = -0.1, and k2 increased by 1.
    np.testing.assert_allclose(after - before, -0.1, rtol=1e-12)


def test_inputs_are_not_changed() -> None:
    controller = controller_of()
    q, desired = np.array([0.1, 0.2]), np.arange(6.0).reshape(3, 2)
    controller.tick(q, desired, 0.0)
    assert q.tolist() == [0.1, 0.2]
    assert desired.tolist() == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if law.uses_model])
def test_a_rejected_disturbance_is_subtracted_from_the_commanded_acceleration(law: str) -> None:
    observed = {"law.name": law, "estimator.name": "extended_state_observer", "robot.description": "panda"}
    without, rejecting = (
        controller_of(observed, limits__effort=1e12, law__disturbance_rejection=rejects) for rejects in (False, True)
    )
    positions, desired = walk(7, 11, samples=2)
    for controller in (without, rejecting):
        controller.tick(positions[0], desired[0], 0.0)
        controller.state.estimator[:, 2] = np.linspace(-3.0, 3.0, 7)
        controller.tick(positions[1], desired[1], DT)
    disturbance = rejecting.state.estimator[:, 2]
    np.testing.assert_array_equal(disturbance, without.state.estimator[:, 2])
    np.testing.assert_allclose(
        rejecting.state.signals[Signal.ACCELERATION_COMMAND],
        without.state.signals[Signal.ACCELERATION_COMMAND] - disturbance,
        rtol=1e-12,
    )


def test_friction_is_compensated_at_the_desired_velocity_and_unknown_to_the_observer() -> None:
    coulomb, viscous = (2.0, 0.5), (0.3, 0.1)
    observed = {"estimator.name": "extended_state_observer"}
    without = controller_of(observed, limits__effort=1e12)
    friction = {"compensation__coulomb": coulomb, "compensation__viscous": viscous}
    compensating = controller_of(observed, limits__effort=1e12, **friction)
    desired = np.array([[0.1, -0.2], [0.5, -1.5], [0.0, 0.0]])
    for k in range(3):
        for controller in (without, compensating):
            controller.tick(np.array([0.1, -0.2]), desired, DT if k else 0.0)
        # The observer sees the torque that accelerates the arm, so both have the same estimates.
        efforts = [controller.state.signals[Signal.EFFORT] for controller in (compensating, without)]
        expected = np.sign(desired[1]) * coulomb + desired[1] * viscous
        np.testing.assert_allclose(efforts[0] - efforts[1], expected, rtol=1e-12)
        np.testing.assert_allclose(
            compensating.state.signals[: Signal.POSITION_ERROR],
            without.state.signals[: Signal.POSITION_ERROR],
            atol=1e-12,
        )


def test_rejection_needs_an_estimator_that_estimates_the_disturbance() -> None:
    with pytest.raises(ParameterError, match=r"law\.disturbance_rejection: estimator\.name must be extended_state_obs"):
        controller_of({"estimator.name": "filtered_difference"}, law__disturbance_rejection=True)
