"""The closed loop: the numbers of the article's cases, determinism, and what it refuses."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.laws import LAWS
from pidtsm_core.metrics import metrics
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.plant import Plant, plant_schema
from pidtsm_core.references import ReferenceMotion, extrapolate, reference_schema
from pidtsm_core.rollout import DivergedError, Rollout, rollout
from pidtsm_core.signals import Signal
from pidtsm_core.timing import period_nanoseconds, seconds

ARTICLE = {
    "estimator.name": "exact",
    "law.upsilon": 0.01,
    "law.u_s": 5.0,
    "law.xi": 0.01,
    "law.anti_windup": "none",
}
CASE_2 = {"payload.mass": 0.5, "payload.time": 15.0}


def measured(run: Rollout) -> dict[str, list[Any]]:
    return metrics(
        run.time, run.position - run.reference[:, 0], run.effort, run.signals[:, Signal.SATURATED], event_time=None
    )


@pytest.mark.parametrize(
    ("controller", "simulator", "rmse"),
    [
        (ARTICLE, {}, (0.037988, 0.008597)),
        (ARTICLE, CASE_2, (0.037989, 0.008598)),
        ({**ARTICLE, "law.anti_windup": "conditional"}, {}, (0.038091, 0.008602)),
    ],
    ids=["case1", "case2", "case1-conditional"],
)
def test_errors_are_those_of_an_independent_simulation(
    controller: dict[str, Any], simulator: dict[str, Any], rmse: tuple[float, float]
) -> None:
    run = rollout({"controller": controller, "simulator": simulator}, 30.0)
    assert measured(run)["rmse"] == pytest.approx(rmse, abs=1e-5)


@pytest.fixture(scope="module")
def default_run() -> Rollout:
    return rollout({}, 30.0)


def test_defaults_do_as_well_without_measured_derivatives(default_run: Rollout) -> None:
    found = measured(default_run)
    assert 0.0376 <= found["rmse"][0] <= 0.0385
    assert 0.0083 <= found["rmse"][1] <= 0.0093
    assert found["steady_state_error"][0] <= 7e-4
    assert found["steady_state_error"][1] <= 2e-5
    assert found["eci"] == pytest.approx([31.19, 12.03], rel=0.01)
    assert default_run.signals[-1, Signal.ADAPTIVE_GAIN].max() <= 20.0


def test_the_loop_is_deterministic(default_run: Rollout) -> None:
    again = rollout({}, 30.0)
    for name in ("time", "position", "velocity", "effort", "reference", "signals"):
        assert getattr(again, name).tobytes() == getattr(default_run, name).tobytes(), name


def test_rows_belong_together(default_run: Rollout) -> None:
    run = default_run
    assert len(run.time) == 30_000
    assert run.time[1234] == 1.234
    assert run.joints == ("joint1", "joint2")
    np.testing.assert_array_equal(run.position[0], [0.0, -0.1])
    np.testing.assert_array_equal(run.velocity[0], 0.0)
    np.testing.assert_array_equal(run.effort, run.signals[:, Signal.EFFORT])
    np.testing.assert_array_equal(run.position, run.signals[:, Signal.POSITION])
    np.testing.assert_allclose(np.diff(run.position, axis=0) / 0.001, run.velocity[:-1], atol=0.1)
    assert (np.abs(run.effort) <= [100.0, 50.0]).all()


@pytest.mark.parametrize("law", LAWS.names)
@pytest.mark.parametrize("rate", [1000, 300])
def test_stepping_the_parts_as_the_nodes_do_gives_the_same_bits(law: str, rate: int) -> None:
    settings = {"controller": {"law.name": law}, "simulator": {"rate": rate, **CASE_2, "payload.time": 0.5}}
    samples = 2000
    period = period_nanoseconds(rate)
    run = rollout(settings, samples * period / 1e9)
    assert len(run.time) == samples

    controller = Controller(resolve(controller_schema, settings["controller"], 2))
    plant = Plant(resolve(plant_schema, settings["simulator"], 2))
    motion = ReferenceMotion(resolve(reference_schema, {}, 2))
    reference, desired = np.zeros((3, 2)), np.zeros((3, 2))
    last = -1
    for k in range(samples):
        stamp = k * period
        measured_position, velocity = plant.state.position.copy(), plant.state.derivatives[0].copy()
        motion.evaluate(seconds(stamp), reference)
        extrapolate(reference, seconds(stamp - stamp), desired)
        signals = controller.step(measured_position, desired, 0.0 if last < 0 else seconds(stamp - last))
        last = stamp
        plant.step(signals[Signal.EFFORT].copy(), seconds(stamp), seconds(period))
        assert run.time[k] == seconds(stamp)
        assert run.position[k].tobytes() == measured_position.tobytes(), k
        assert run.velocity[k].tobytes() == velocity.tobytes(), k
        assert run.reference[k].tobytes() == desired.tobytes(), k
        assert run.signals[k].tobytes() == signals.tobytes(), k
        assert run.effort[k].tobytes() == plant.state.effort.tobytes(), k


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"contoller": {}}, "unknown node contoller"),
        ({"controller": {"law.k9": 1.0}}, r"controller: .*law\.k9"),
        ({"simulator": {"payload.mas": 1.0}}, r"simulator: .*did you mean payload\.mass"),
        ({"trajectory": {"reference.speed": 1.0}}, r"trajectory: .*reference\.speed"),
        ({"controller": {"law.k1": -1.0}}, r"controller: law\.k1"),
        ({"controller": {"law.name": "piddtms"}}, r"controller: law\.name.*did you mean piddtsm"),
        ({"simulator": {"robot.name": "two_lnk"}}, r"simulator: robot\.name.*did you mean two_link"),
        ({"controller": {"robot.name": "two_lnk"}}, r"controller: robot\.name.*did you mean two_link"),
        ({"simulator": {"initial_position": [0.0, 1.0, 2.0]}}, r"simulator: initial_position.*2 joints"),
    ],
)
def test_settings_without_sense_are_refused_with_the_name_of_the_node(settings: Any, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        rollout(settings, 0.01)


@pytest.mark.parametrize("duration", [0.0, 0.0004, -1.0, float("nan"), float("inf")])
def test_a_duration_without_samples_or_end_is_refused(duration: float) -> None:
    with pytest.raises(ParameterError, match="duration"):
        rollout({}, duration)


def test_one_sample_is_a_run() -> None:
    run = rollout({}, 0.001)
    assert run.time.tolist() == [0.0]


def test_a_loop_that_leaves_the_finite_numbers_says_when() -> None:
    # A second between samples, and no torque to speak of.
    settings = {"controller": {"limits.effort": 1e-3}, "simulator": {"limits.effort": 1e-3, "rate": 1}}
    with pytest.raises(DivergedError, match=r"after \d+(\.\d+)? s"):
        rollout(settings, 1000.0)
