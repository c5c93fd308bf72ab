"""Random numbers depend only on the seed and their purpose."""

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.simulation.randomness import Column, Randomness, columns
from pidtsm_core.simulation.simulator import simulator_schema

ALL = {
    "noise.std": 1e-3,
    "actuator.noise": 1e-3,
    "effort_sensor.noise": 1e-3,
    "jitter.std": 1e-4,
    "dropout.probability": 0.1,
    "dropout.burst_rate": 1.0,
    "dropout.command_probability": 0.1,
    "dropout.command_burst_rate": 1.0,
}
SAMPLES = 3000


def source(arm: Arm, **changes: object) -> Randomness:
    return Randomness(arm.values(simulator_schema, {**ALL, **changes}), arm.joints)


def test_drawing_in_parts_gives_the_same_numbers(arm: Arm) -> None:
    """A rollout draws all numbers at once, a node row by row from blocks."""
    whole = source(arm).draw(SAMPLES)
    a, b = source(arm), source(arm)
    np.testing.assert_array_equal([a.next() for _ in range(SAMPLES)], whole)
    np.testing.assert_array_equal(np.vstack([b.draw(n) for n in (1, 7, 0, 992, 2000)]), whole)


def test_seeds_decide(arm: Arm) -> None:
    np.testing.assert_array_equal(source(arm, seed=5).draw(SAMPLES), source(arm, seed=5).draw(SAMPLES))
    assert (source(arm, seed=5).draw(SAMPLES) != source(arm, seed=6).draw(SAMPLES)).all()


def test_purposes_are_independent_and_have_their_distributions(arm: Arm) -> None:
    rows = source(arm).draw(100_000)
    assert np.abs(np.corrcoef(rows.T) - np.eye(columns(arm.joints))).max() < 0.02
    uniform, normal = rows[:, : Column.JITTER], rows[:, Column.JITTER :]
    assert uniform.min() >= 0.0
    assert uniform.max() < 1.0
    np.testing.assert_allclose(uniform.mean(axis=0), 0.5, atol=0.01)
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(normal.std(axis=0), 1.0, atol=0.02)


@pytest.mark.parametrize("switch", ALL)
def test_what_is_off_draws_nothing_and_changes_nothing_else(arm: Arm, switch: str) -> None:
    everything, rest = source(arm).draw(SAMPLES), source(arm, **{switch: 0.0}).draw(SAMPLES)
    off = ~rest.any(axis=0)
    assert off.sum() == (arm.joints if switch.endswith("noise") or switch == "noise.std" else 1)
    np.testing.assert_array_equal(rest[:, ~off], everything[:, ~off])


def test_a_purpose_may_be_switched_on_under_way(arm: Arm) -> None:
    randomness = Randomness(arm.values(simulator_schema, {}), arm.joints)
    assert not randomness.next().any()
    randomness.set_parameters(arm.values(simulator_schema, {"noise.std": 1e-3}))
    assert randomness.next()[Column.NOISE : Column.NOISE + arm.joints].all()
