"""Metrics against values calculated by hand, and properties that hold for every run."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pidtsm_core.arrays import Array
from pidtsm_core.recording.metrics import metrics, tracking_error

TIME = np.arange(10) / 10.0
FALLING = np.array([1.0, 0.5, 0.1, 0.01, 0.03, 0.01, 0.005, -0.004, 0.003, 0.002])
SIZES = st.floats(min_value=-100.0, max_value=100.0).map(lambda x: round(x, 6))


def of(error: Array, effort: Array | None = None, event_time: float | None = None, **kwargs: Any) -> dict[str, Any]:
    """Metrics of one joint, each as a single value."""
    tau = np.zeros_like(error) if effort is None else effort
    values = metrics(TIME, error[:, None], tau[:, None], kwargs.get("saturated", 0 * error)[:, None], event_time)
    return {name: value for name, (value,) in values.items()}


def test_rmse_and_eci_are_those_of_eqs_53_and_54() -> None:
    values = metrics([0, 1], [[3.0, 0.0], [-4.0, 0.0]], [[2.0, -1.0], [-4.0, 0.0]], np.zeros((2, 2)))
    assert values["rmse"] == [pytest.approx(12.5**0.5), 0.0]
    assert values["eci"] == [3.0, 0.5]


def test_steady_state_error_is_the_largest_of_the_last_forty_percent() -> None:
    # 60 % of 0.9 s is 0.54 s: samples 6 to 9 count.
    assert of(FALLING)["steady_state_error"] == 0.005


def test_settling_time_is_after_the_last_time_above_two_percent() -> None:
    assert of(FALLING)["settling_time"] == pytest.approx(0.5)


def test_settling_time_counts_from_the_first_sample() -> None:
    values = metrics(TIME + 7.0, FALLING[:, None], FALLING[:, None], FALLING[:, None])
    assert values["settling_time"] == [pytest.approx(0.5)]


def test_settling_time_looks_only_until_the_event() -> None:
    disturbed = FALLING.copy()
    disturbed[8] = 1.0
    assert of(disturbed)["settling_time"] == pytest.approx(0.9)
    assert of(disturbed, event_time=0.8)["settling_time"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("error", "event_time"),
    [
        pytest.param(np.ones(10), None, id="never settles"),
        pytest.param(np.zeros(10), None, id="no error at the start"),
        pytest.param(FALLING, 0.0, id="event at the start"),
    ],
)
def test_settling_time_may_not_exist(error: Array, event_time: float | None) -> None:
    assert of(error, event_time=event_time)["settling_time"] is None


def test_recovery_time_exists_only_with_an_event() -> None:
    assert "recovery_time" not in of(FALLING)


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        ([0.5, 1e-4, -0.2, 9e-4, -5e-4], 0.3),
        ([0.5, 0.5, 0.5, 0.5, 1e-3], None),
        ([0.0, 0.0, 0.0, 0.0, 0.0], 0.0),
    ],
)
def test_recovery_time_is_from_the_event_until_below_a_milliradian_for_good(
    after: list[float], expected: float | None
) -> None:
    value = of(np.array([1.0, 0, 0, 0, 0, *after]), event_time=0.5)["recovery_time"]
    assert value == (None if expected is None else pytest.approx(expected))


def test_event_after_the_end_has_no_recovery() -> None:
    assert of(FALLING, event_time=5.0)["recovery_time"] is None


def test_torque_variation_and_jumps() -> None:
    tau = np.array([0.0, 5.0, 5.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 8.0])
    values = of(FALLING, tau)
    assert values["torque_variation"] == pytest.approx((5 + 6 + 9) / 9)
    assert values["torque_jumps"] == 2  # a change of exactly 5 N m does not count
    assert isinstance(values["torque_jumps"], int)


def test_saturation_is_a_share_of_the_samples() -> None:
    assert of(FALLING, saturated=np.array([1.0, 1.0, 1.0, 0, 0, 0, 0, 0, 0, 0]))["saturation"] == pytest.approx(0.3)


def test_one_sample_has_no_variation() -> None:
    values = metrics([0.0], [[0.1, 0.2]], [[1.0, 2.0]], [[0.0, 1.0]])
    assert values["torque_variation"] == [None, None]
    assert values["settling_time"] == [None, None]
    assert values["saturation"] == [0.0, 1.0]


@pytest.mark.parametrize(
    ("time", "error", "effort", "saturated", "cause"),
    [
        ([], np.empty((0, 1)), np.empty((0, 1)), np.empty((0, 1)), "at least one sample"),
        ([0.0, 1.0], [1.0, 2.0], [[1.0], [2.0]], [[0.0], [0.0]], "must have shape"),
        ([0.0, 1.0], [[1.0], [2.0]], [[1.0, 2.0]] * 2, [[0.0], [0.0]], "must have shape"),
        ([0.0, 1.0], [[1.0], [np.nan]], [[1.0], [2.0]], [[0.0], [0.0]], "finite"),
        ([0.0, 1.0], [[1.0], [2.0]], [[1.0], [np.inf]], [[0.0], [0.0]], "finite"),
        ([0.0, 0.0], [[1.0], [2.0]], [[1.0], [2.0]], [[0.0], [0.0]], "must increase"),
    ],
)
def test_invalid_runs_are_refused(time: Any, error: Any, effort: Any, saturated: Any, cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        metrics(time, error, effort, saturated)


runs = st.tuples(st.integers(1, 30), st.integers(1, 4)).flatmap(
    lambda shape: st.tuples(
        hnp.arrays(np.float64, shape, elements=SIZES),
        hnp.arrays(np.float64, shape, elements=SIZES),
        hnp.arrays(np.float64, shape, elements=st.sampled_from([0.0, 1.0])),
        st.none() | st.floats(-1.0, 31.0),
    )
)


@given(runs)
def test_values_are_within_their_bounds_and_valid_json(run: tuple[Array, Array, Array, float | None]) -> None:
    error, effort, saturated, event_time = run
    values = metrics(np.arange(len(error)), error, effort, saturated, event_time)
    json.dumps(values, allow_nan=False)
    for name, per_joint in values.items():
        assert len(per_joint) == error.shape[1], name
        assert all(value is None or value >= 0.0 for value in per_joint), name
    assert np.all(np.array(values["rmse"]) <= np.abs(error).max(axis=0) * (1 + 1e-12))
    assert np.all(np.array(values["eci"]) <= np.abs(effort).max(axis=0) * (1 + 1e-12))
    assert np.all(np.array(values["steady_state_error"]) <= np.abs(error).max(axis=0))
    assert np.all(np.array(values["saturation"]) <= 1.0)


@given(runs)
def test_joints_do_not_affect_each_other(run: tuple[Array, Array, Array, float | None]) -> None:
    error, effort, saturated, event_time = run
    time = np.arange(len(error))
    together = metrics(time, error, effort, saturated, event_time)
    for j in range(error.shape[1]):
        alone = metrics(time, error[:, [j]], effort[:, [j]], saturated[:, [j]], event_time)
        for name, (value,) in alone.items():
            # The order of summation may differ between one column and many.
            assert together[name][j] == (value if value is None else pytest.approx(value, rel=1e-12)), name


@given(runs, st.sampled_from([-1.0, 0.5, 4.0]))
def test_sizes_scale_with_the_signal_and_times_do_not(
    run: tuple[Array, Array, Array, float | None], factor: float
) -> None:
    error, effort, saturated, _ = run
    time = np.arange(len(error))
    one, other = metrics(time, error, effort, saturated), metrics(time, factor * error, factor * effort, saturated)
    for name in ("rmse", "eci", "steady_state_error"):
        assert other[name] == pytest.approx(abs(factor) * np.array(one[name]), rel=1e-12)
    assert other["settling_time"] == one["settling_time"]
    assert other["saturation"] == one["saturation"]


@pytest.mark.parametrize("begin", [-2, 0, 1])
@pytest.mark.parametrize("turning", [0.0, 3.0, -8.0])
def test_whole_turns_are_no_error_of_a_continuous_joint(begin: int, turning: float) -> None:
    time = np.linspace(0.0, 5.0, 5001)
    small = 0.1 * np.sin(time)
    motion = turning * time
    position = np.column_stack([motion + small + 2.0 * math.pi * begin, motion + small])
    for desired in (motion, np.remainder(motion + 1.0, 2.0 * math.pi) - 1.0):
        error = tracking_error(position, np.column_stack([desired, motion]), (True, False))
        np.testing.assert_allclose(error, np.column_stack([small, small]), atol=1e-12)


def test_a_continuous_joint_that_spins_away_has_a_growing_error() -> None:
    spinning = np.linspace(0.0, 20.0, 1001)[:, None]
    np.testing.assert_allclose(tracking_error(spinning, 0.0 * spinning, (True,)), spinning)
    np.testing.assert_array_equal(tracking_error(spinning, 0.0 * spinning, ()), spinning)
