"""Streams of targets: the motion is smooth, keeps every limit, follows soon, and rests when the stream stops."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.margins import PLANNED_SHARE
from pidtsm_core.trajectories.motion import Motion
from pidtsm_core.trajectories.stopping import stop
from pidtsm_core.trajectories.streams import StreamFilter

Hand = Callable[[Any], Any]
"""Position of one joint, rad, at a time or an array of times, s."""

MS = 1_000_000
START = 5_000_000 * MS
"""Time of the first tick, ns."""


def make_limits(
    joints: int = 1, velocity: float = 2.5, acceleration: float = 10.0, jerk: float = 500.0
) -> MotionLimits:
    one = np.ones(joints)
    return replace(
        motion_limits({"joints": tuple(f"joint{j + 1}" for j in range(joints))}),
        lower=-1.0 * one,
        upper=1.5 * one,
        velocity=velocity * one,
        acceleration=acceleration * one,
        jerk=jerk * one,
    )


@dataclass
class Message:
    """A target, or a chunk of them if there are times; times in s from `START`."""

    arrival: float
    stamp: float | None
    positions: Array
    times: Array | None = None


def messages(
    motion: Hand, rate: float, end: float, rng: np.random.Generator, stamped: bool = True
) -> Iterator[Message]:
    """Samples of a motion, 5 % of them missing, each up to 20 ms late, delivered in order."""
    arrival = 0.0
    for k in range(int(end * rate)):
        if rng.random() >= 0.05:
            arrival = max(arrival, k / rate + rng.uniform(0.0, 0.02))
            yield Message(arrival, k / rate if stamped else None, np.array([motion(k / rate)]))


def sums(seed: int) -> Hand:
    """A motion like that of a hand: three sines with up to about 1 rad/s and 6 rad/s^2."""
    rng = np.random.default_rng(seed)
    frequency, phase = np.array([0.3, 0.8, 1.3]) * rng.uniform(0.8, 1.2, 3), rng.uniform(0.0, 6.0, 3)
    return lambda t: np.sin(2.0 * math.pi * np.multiply.outer(t, frequency) + phase) @ np.array([0.3, 0.1, 0.02])


def follow(given: Iterator[Message], limits: MotionLimits, end: float, start: float = 0.0) -> Array:
    """The motion at every ms, shape (ticks, 3, joints): that of the stream, and a stop when it has ended."""
    stream, desired = StreamFilter(limits), np.zeros((3, len(limits.joints)))
    desired[0] = start
    motion: Motion | None = None
    began, due, motions = START, next(given, None), []
    for tick in range(round(end * 1e3)):
        now = START + tick * MS
        stream.advance(now)
        if motion:
            motion.evaluate(1e-9 * (now - began), desired)
        motions.append(desired.copy())
        while due and due.arrival <= 1e-3 * tick:
            stamp = 0 if due.stamp is None else START + round(due.stamp * 1e9)
            if due.times is None:
                stream.receive(now, stamp, due.positions)
            else:
                stream.receive_chunk(now, stamp, due.times, due.positions)
            if not stream.running:
                stream.begin(now, desired)
                motion, began = stream, now
            due = next(given, None)
        if stream.running and stream.ended(now):
            stream.end()
            motion, began = stop(desired, limits), now
    return np.array(motions)


def check_limits(motions: Array, limits: MotionLimits) -> None:
    """Within all limits at every tick, with a continuous acceleration that belongs to the positions."""
    assert np.isfinite(motions).all()
    q, dq, ddq = motions.transpose(1, 0, 2)
    assert (q >= limits.lower).all()
    assert (q <= limits.upper).all()
    assert (np.abs(dq) <= limits.planned_velocity).all()
    assert (np.abs(ddq) <= limits.acceleration + 1e-9).all()
    steps = 1e-3 * limits.jerk + 1e-9
    assert (np.abs(np.diff(ddq, axis=0)) <= steps).all()
    np.testing.assert_allclose(np.diff(dq, axis=0), 5e-4 * (ddq[1:] + ddq[:-1]), atol=1e-3 * steps.max())
    np.testing.assert_allclose(np.diff(q, axis=0), 5e-4 * (dq[1:] + dq[:-1]), atol=1e-6 * steps.max())


def delay(motions: Array, motion: Hand, begin: float, end: float) -> tuple[float, float]:
    """Delay behind a motion in a span of time, for which the root mean square error is smallest, and that error."""
    span = np.arange(round(begin * 1e3), round(end * 1e3))
    delays = np.arange(0.0, 0.2, 1e-3)
    errors = [np.mean((motions[span, 0, 0] - motion(1e-3 * span - d)) ** 2) for d in delays]
    return float(delays[np.argmin(errors)]), math.sqrt(min(errors))


@given(
    joints=st.integers(1, 7),
    velocity=st.floats(0.2, 3.0),
    acceleration=st.floats(1.0, 20.0),
    ramp=st.floats(0.003, 0.3),
    seed=st.integers(0, 10**6),
)
@settings(max_examples=15)
def test_whatever_is_sent_the_motion_keeps_its_limits_and_is_smooth(
    joints: int, velocity: float, acceleration: float, ramp: float, seed: int
) -> None:
    limits, rng = make_limits(joints, velocity, acceleration, acceleration / ramp), np.random.default_rng(seed)

    def sent() -> Iterator[Message]:
        target, time = np.zeros(joints), 0.0
        while time < 2.0:
            time += rng.exponential(rng.choice([0.003, 0.03, 0.3]))
            target = target + rng.normal(0.0, rng.choice([0.01, 0.1, 1.0]), joints)
            if rng.random() < 0.2:
                times = np.cumsum(rng.uniform(0.001, 0.1, 20))
                way = target + np.cumsum(rng.normal(0.0, 0.05, (20, joints)), axis=0)
                yield Message(time, time + rng.uniform(-0.02, 0.2), way, times)
            else:
                yield Message(time, None, target)

    check_limits(follow(sent(), limits, 2.5), limits)


@pytest.mark.parametrize("stamped", [True, False], ids=["stamped", "without stamps"])
@pytest.mark.parametrize(("rate", "most"), [(10.0, 0.15), (30.0, 0.06), (100.0, 0.04), (500.0, 0.03)])
def test_a_motion_is_followed_with_a_bounded_delay(rate: float, most: float, stamped: bool) -> None:
    limits, motion = make_limits(), sums(1)
    sent = messages(motion, rate, 6.0, np.random.default_rng(2), stamped)
    motions = follow(sent, limits, 6.0, motion(0.0))
    check_limits(motions, limits)
    late, error = delay(motions, motion, 2.0, 6.0)
    assert late <= most + (0.0 if stamped or rate <= 30.0 else 0.03)
    assert error < (0.02 if rate < 30.0 else 0.004 if stamped else 0.01)


@pytest.mark.parametrize("seed", range(10))
def test_a_stream_that_stops_leaves_the_arm_at_rest_within_the_time_that_its_deceleration_allows(seed: int) -> None:
    limits, motion, end = make_limits(), sums(seed), 2.0 + 0.1 * seed
    sent = list(messages(motion, 30.0, end, np.random.default_rng(seed)))
    motions = follow(iter(sent), limits, end + 1.0, motion(0.0))
    check_limits(motions, limits)
    last, position = sent[-1].arrival, sent[-1].positions[0]
    assert not motions[round((last + 0.3) * 1e3) + 1 :, 1:].any()
    # Half of the way in the delay, and the way that the limits need to stop.
    speed = abs(motion(last) - motion(last - 0.05)) / 0.05
    assert abs(motions[-1, 0, 0] - position) < 1e-3 + 0.04 * speed + speed**2 / (2.0 * 10.0) + speed * 10.0 / 500.0


def test_a_motion_that_ends_at_rest_is_not_overshot() -> None:
    limits = make_limits()

    def motion(t: Any) -> Any:
        x = np.minimum(t / 1.5, 1.0)
        return 0.5 * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)

    motions = follow(messages(motion, 30.0, 2.0, np.random.default_rng(3)), limits, 2.5)
    assert motions[:, 0].max() <= 0.5 + 1e-3
    assert motions[-1, 0, 0] == pytest.approx(0.5, abs=1e-4)
    assert not motions[-1, 1:].any()


@pytest.mark.parametrize("jerk", [50.0, 200.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("step", [0.5, -0.9, 0.01])
def test_a_step_of_the_target_is_followed_without_overshoot(step: float, jerk: float) -> None:
    limits = make_limits(jerk=jerk)
    sent = (Message(k / 30.0, k / 30.0, np.array([step if k > 5 else 0.0])) for k in range(60))
    motions = follow(sent, limits, 2.0)
    check_limits(motions, limits)
    assert (motions[:, 0] * math.copysign(1.0, step)).max() <= abs(step) + 0.01
    assert motions[-1, 0, 0] == pytest.approx(step, abs=1e-6)


def test_a_stream_that_begins_elsewhere_is_approached_within_the_limits() -> None:
    limits = make_limits(velocity=0.8)
    sent = messages(lambda t: 1.4 + 0.0 * t, 30.0, 4.0, np.random.default_rng(4))
    motions = follow(sent, limits, 4.0, start=-0.9)
    check_limits(motions, limits)
    assert np.abs(motions[:, 1]).max() == pytest.approx(PLANNED_SHARE * 0.8, rel=1e-2)
    assert motions[-1, 0, 0] == pytest.approx(1.4, abs=1e-6)


def test_overlapping_chunks_are_spliced_smoothly() -> None:
    limits, motion, rng = make_limits(), sums(5), np.random.default_rng(5)
    times = np.arange(50) / 30.0

    def sent() -> Iterator[Message]:
        # As a policy sends them: every 0.4 s, 60 ms after the observation, none equal to the one before.
        for k in range(10):
            way = motion(0.4 * k + times)[:, None] + rng.normal(0.0, 0.01)
            yield Message(0.4 * k + 0.06, 0.4 * k, way, times)

    motions = follow(sent(), limits, 7.0, motion(0.0))
    check_limits(motions, limits)
    span = np.arange(500, 5000)
    assert np.abs(motions[span, 0, 0] - motion(1e-3 * span)).max() < 0.05
    assert np.abs(motions[span, 2]).max() < 8.0, "the limit of 10 is not needed"
    assert not motions[-1, 1:].any()


def used(limits: MotionLimits) -> StreamFilter:
    """A stream of five targets."""
    stream = StreamFilter(limits)
    for k in range(5):
        stream.receive(START + 33 * k * MS, START + 33 * k * MS, np.full(len(limits.joints), 0.01 * k))
    stream.begin(START + 132 * MS, np.zeros((3, len(limits.joints))))
    return stream


NAN = math.nan
NOW = START + 165 * MS


@pytest.mark.parametrize(
    ("send", "reason"),
    [
        (lambda s: s.receive(NOW, NOW, np.array([0.1, NAN])), "position is not finite"),
        (lambda s: s.receive(NOW, NOW, np.array([0.1, 0.1]), np.array([math.inf, 0.0])), "velocity is not finite"),
        (lambda s: s.receive(NOW, START, np.zeros(2)), "late: the stamp is older"),
        (lambda s: s.receive(NOW, START + 132 * MS, np.zeros(2)), "repeated: the stamp equals"),
        (lambda s: s.receive(NOW, NOW + 1000 * MS, np.zeros(2)), "ahead: the stamp is ahead"),
        (lambda s: s.receive_chunk(NOW, 0, np.array([0.1, 0.1]), np.zeros((2, 2))), "increase from point to point"),
        (lambda s: s.receive_chunk(NOW, 0, np.array([0.1, NAN]), np.zeros((2, 2))), "increase from point to point"),
        (lambda s: s.receive_chunk(NOW, 0, np.empty(0), np.empty((0, 2))), "increase from point to point"),
        (lambda s: s.receive_chunk(NOW, 0, np.array([0.1]), np.full((1, 2), NAN)), "position is not finite"),
        (lambda s: s.receive_chunk(NOW, START, np.array([0.1]), np.zeros((1, 2))), "it is over: it started 0.165 s"),
        (lambda s: s.receive_chunk(NOW, 0, np.arange(2000.0), np.zeros((2000, 2))), "2000 points; at most 1000"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason_and_changes_nothing(
    send: Callable[[StreamFilter], str], reason: str
) -> None:
    stream, twin = used(make_limits(2)), used(make_limits(2))
    desired, expected = np.zeros((3, 2)), np.zeros((3, 2))
    with pytest.raises(TrajectoryError, match=reason):
        send(stream)
    for k in range(1, 100):
        stream.advance(START + 132 * MS + k * MS)
        stream.evaluate(1e-3 * k, desired)
        twin.advance(START + 132 * MS + k * MS)
        twin.evaluate(1e-3 * k, expected)
        np.testing.assert_array_equal(desired, expected)


def test_a_motion_without_further_targets_is_foreseen() -> None:
    stream, foreseen, desired = used(make_limits(2)), np.zeros((3, 2)), np.zeros((3, 2))
    stream.freeze()
    stream.evaluate(0.05, foreseen)
    for k in range(1, 51):
        stream.advance(START + (132 + k) * MS)
    stream.evaluate(0.05, desired)
    assert desired[0].all()
    np.testing.assert_allclose(foreseen, desired, atol=1e-9)


def test_targets_beyond_the_limits_are_clipped_with_a_warning() -> None:
    stream = used(make_limits(2))
    warning = stream.receive(NOW, NOW, np.array([0.0, 9.0]))
    assert warning == "joint2 is clipped to its limits, -1 to 1.5"
    assert stream.targets(np.zeros(2))[1] == pytest.approx(1.5, abs=1e-3)
    assert stream.statistics(NOW).clipped == 1


def test_a_joint_that_turns_without_end_takes_the_shorter_way() -> None:
    limits = replace(make_limits(), continuous=np.array([True]), lower=np.array([-np.inf]), upper=np.array([np.inf]))
    sent = (Message(k / 30.0, k / 30.0, np.array([math.remainder(3.0 + 0.01 * k, math.tau)])) for k in range(60))
    motions = follow(sent, limits, 2.0, start=3.0)
    assert motions[-1, 0, 0] == pytest.approx(3.58, abs=0.01)
    assert np.abs(motions[:, 1]).max() < 0.5


def test_its_statistics_show_how_it_arrives() -> None:
    stream, sent = StreamFilter(make_limits()), messages(sums(6), 30.0, 20.0, np.random.default_rng(6))
    arrivals = [message.arrival for message in sent if _receive(stream, message)]
    statistics = stream.statistics(START + round((arrivals[-1] + 0.25) * 1e9))
    assert statistics.rate == pytest.approx(30.0, rel=0.05)
    assert statistics.delay == pytest.approx(0.05, abs=0.01)
    assert statistics.age == pytest.approx(0.25, abs=1e-6)
    assert statistics.received == len(arrivals)
    assert statistics.missing == pytest.approx(600 - len(arrivals), abs=1)


def _receive(stream: StreamFilter, message: Message) -> bool:
    now = START + round(message.arrival * 1e9)
    return not stream.receive(now, START + round((message.stamp or 0.0) * 1e9), message.positions)
