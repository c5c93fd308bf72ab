"""Losses and delays of a transport: whole packets, whatever the number of joints."""

import numpy as np
import pytest
from numpy.typing import NDArray
from support.testarms import Arm

from pidtsm_core.parameters import resolve
from pidtsm_core.simulation.channel import arrived, channel_config, channel_state, loses, place
from pidtsm_core.simulation.simulator import simulator_schema

SAMPLES = 100_000
PREFIX = pytest.mark.parametrize("prefix", ["", "command_"], ids=["measurements", "commands"])


def losses(prefix: str, rate: int = 1000, samples: int = SAMPLES, **changes: object) -> NDArray[np.bool_]:
    """Whether each sample is lost."""
    given = {f"dropout.{prefix}{name}": value for name, value in changes.items()}
    values = resolve(simulator_schema, {"rate": rate, **given}, 2)
    config, state = channel_config(values, prefix), channel_state(values, prefix, 1, 2)
    draws = np.random.default_rng(1).random((samples, 2))
    return np.array([loses(config, state, k, a, b) for k, (a, b) in enumerate(draws)])


def bursts(lost: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lengths of the runs of losses."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]])))
    return edges[1::2] - edges[::2]


@PREFIX
def test_single_losses_come_at_their_rate_and_independently(prefix: str) -> None:
    lost = losses(prefix, probability=0.05)
    assert lost.mean() == pytest.approx(0.05, rel=0.05)
    assert (lost[1:] & lost[:-1]).mean() == pytest.approx(0.05**2, rel=0.2)


@PREFIX
def test_bursts_have_their_length_and_rate(prefix: str) -> None:
    lengths = bursts(losses(prefix, burst=20, burst_rate=2.0))
    # Some bursts follow directly after another.
    assert set(lengths) <= {20, 40}
    # 2 per second of the time between bursts, at 1 kHz.
    expected = 2.0 / (1.0 + 2.0 * 0.02) * SAMPLES / 1000
    assert (lengths / 20).sum() == pytest.approx(expected, rel=0.15)


def test_both_at_once() -> None:
    both = losses("", probability=0.05, burst=20, burst_rate=1.0)
    assert both.mean() == pytest.approx(1.0 - 0.95 * (1.0 - 0.02 / 1.02), rel=0.1)
    assert (bursts(both) >= 20).any()
    assert (bursts(both) == 1).any()


@PREFIX
@pytest.mark.parametrize(
    ("rate", "time", "duration", "first", "end"),
    [(1000, 0.5, 0.2, 500, 700), (1000, 0.1, 0.2, 100, 300), (1000, 0.0, 0.0015, 0, 2), (300, 0.1, 0.1, 31, 61)],
)
def test_a_window_loses_exactly_the_samples_within_it(
    prefix: str, rate: int, time: float, duration: float, first: int, end: int
) -> None:
    """A period of 300 Hz is a little shorter than a third of 10 ms, so its 30th sample comes before 0.1 s."""
    lost = losses(prefix, rate, 2000, time=time, duration=duration)
    np.testing.assert_array_equal(np.flatnonzero(lost), np.arange(first, end))


@pytest.mark.parametrize(("probability", "share"), [(0.0, 0.0), (1.0, 1.0)])
def test_nothing_and_everything_may_be_lost(probability: float, share: float) -> None:
    assert losses("", samples=2000, probability=probability).mean() == share


@PREFIX
@pytest.mark.parametrize("delay", [0, 1, 2, 7])
def test_a_packet_arrives_after_the_delay_exactly_once_or_never(arm: Arm, prefix: str, delay: int) -> None:
    values = arm.values(simulator_schema, {f"delay.{prefix}samples": delay})
    state = channel_state(values, prefix, 1, arm.joints)
    kept = np.random.default_rng(2).random(200) < 0.7
    received = {}
    for k in range(200):
        if kept[k]:
            slot = place(state, k)
            state.sent[slot] = k
            state.packets[slot] = np.arange(k, k + arm.joints)
        if arrived(state, k - delay):
            received[k] = state.packets[place(state, k - delay), 0].tolist()
    sent = [k for k in range(200) if kept[k] and k + delay < 200]
    assert received == {k + delay: list(range(k, k + arm.joints)) for k in sent}
