"""Transport of measurements to the controller or of commands to the motors, with delays of whole samples and losses."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters import Parameter, Value, as_float
from pidtsm_core.timing import period_nanoseconds, seconds


def _parameters(prefix: str, what: str) -> tuple[Parameter, ...]:
    return (
        Parameter(
            f"delay.{prefix}samples", 0, f"delay of {what}, in samples", minimum=0, maximum=10_000, read_only=True
        ),
        Parameter(
            f"dropout.{prefix}probability",
            0.0,
            f"probability that one of the {what} is lost, independently of the others",
            minimum=0.0,
            maximum=1.0,
        ),
        Parameter(f"dropout.{prefix}burst", 20, f"number of {what} lost in a burst", minimum=1),
        Parameter(
            f"dropout.{prefix}burst_rate", 0.0, f"bursts of lost {what} per second, at random times", "1/s", minimum=0.0
        ),
        Parameter(
            f"dropout.{prefix}time",
            0.0,
            f"time from the start at which a dropout of all {what} begins",
            "s",
            minimum=0.0,
        ),
        Parameter(f"dropout.{prefix}duration", 0.0, f"how long all {what} are lost; 0: no dropout", "s", minimum=0.0),
    )


PARAMETERS = (*_parameters("", "measurements"), *_parameters("command_", "commands"))


class ChannelConfig(NamedTuple):
    """Parameters of a channel."""

    loss: float  # probability
    burst_begin: float  # probability that a burst begins at a sample
    burst: int  # samples
    out_from: int  # first sample of the outage, in which everything is lost
    out_until: int  # first sample after the outage
    direct: bool  # neither delay nor losses


class ChannelState(NamedTuple):
    """State of a channel: a ring buffer of packets, one more than the delay."""

    packets: Array  # shape (delay + 1, rows, joints)
    sent: NDArray[np.int64]  # sample at which each packet was sent, -1 for an empty slot
    burst_left: NDArray[np.int64]  # shape (1,): remaining samples of the burst


def channel_config(values: Mapping[str, Value], prefix: str) -> ChannelConfig:
    """Configuration of the channel for measurements (no prefix) or commands (``command_``).

    Args:
        values: `PARAMETERS` and ``rate``, as returned by `resolve`.
        prefix: prefix of the last part of the parameter names.
    """
    nanoseconds = period_nanoseconds(int(as_float(values["rate"])))
    period = seconds(nanoseconds)
    loss, burst_begin = (
        as_float(values[f"dropout.{prefix}probability"]),
        as_float(values[f"dropout.{prefix}burst_rate"]) * period,
    )
    begin, duration = as_float(values[f"dropout.{prefix}time"]), as_float(values[f"dropout.{prefix}duration"])
    # The first samples at or after these times, rounded to 1 ns.
    out_from, out_until = (min(-(-round(t * 1e9) // nanoseconds), 2**62) for t in (begin, begin + duration))
    return ChannelConfig(
        loss=loss,
        burst_begin=burst_begin,
        burst=int(as_float(values[f"dropout.{prefix}burst"])),
        out_from=out_from,
        out_until=out_until,
        direct=not (loss or burst_begin or duration or as_float(values[f"delay.{prefix}samples"])),
    )


def channel_state(values: Mapping[str, Value], prefix: str, rows: int, joints: int) -> ChannelState:
    """An empty channel for packets of shape (rows, joints); see `channel_config`."""
    places = int(as_float(values[f"delay.{prefix}samples"])) + 1
    return ChannelState(
        packets=np.zeros((places, rows, joints)),
        sent=np.full(places, -1),
        burst_left=np.zeros(1, dtype=np.int64),
    )


@inlined
def loses(config: ChannelConfig, state: ChannelState, sample: int, loss: float, burst: float) -> bool:
    """Whether the packet of this sample is lost.

    Call it once per sample, with two uniform random numbers. A burst can begin at any sample outside a burst.
    """
    out = config.out_from <= sample < config.out_until
    if state.burst_left[0] == 0 and burst < config.burst_begin:
        state.burst_left[0] = config.burst
    if state.burst_left[0] > 0:
        state.burst_left[0] -= 1
        return True
    return out or loss < config.loss


@inlined
def place(state: ChannelState, sample: int) -> int:
    """Index of a sample's packet in the ring buffer."""
    return sample % state.sent.size


@inlined
def arrived(state: ChannelState, sent: int) -> bool:
    """Whether the packet sent at that sample is in the ring buffer."""
    return sent >= 0 and state.sent[place(state, sent)] == sent
