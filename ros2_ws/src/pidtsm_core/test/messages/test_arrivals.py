"""Decisions about which stamped messages to use."""

import itertools

import numpy as np
import pytest

from pidtsm_core.messages.arrivals import Arrivals, Stamp

MS = 1_000_000
SECOND = 1000 * MS
EPOCH = 1_700_000_000 * SECOND
RATES = [100, 250, 500, 1000]


class Source:
    """A source that publishes at a rate with its own clock; `now` is the receiver's clock."""

    def __init__(self, rate: int = 1000, lockstep: bool = False) -> None:
        self.arrivals = Arrivals()
        self.period = SECOND // rate
        self.lockstep = lockstep
        self.stamp, self.now = EPOCH, 5 * SECOND

    def send(self, later: int = 0, took: int | None = None) -> Stamp:
        """Send a message one period after the last one; its stamp is too late by `later` (ns)."""
        self.stamp += self.period
        self.now += self.period if took is None else took
        stamp, now = self.stamp + later, None if self.lockstep else self.now
        judged = self.arrivals.judge(stamp, now)
        if judged.usable:
            self.arrivals.take(judged, stamp, now)
        return judged

    def go_on(self, messages: int = 50) -> None:
        assert {self.send() for _ in range(messages)} == {Stamp.NEW}


EACH_RATE = pytest.mark.parametrize("rate", RATES)
EACH_CLOCK = pytest.mark.parametrize("lockstep", [False, True], ids=["realtime", "lockstep"])


@EACH_RATE
@EACH_CLOCK
@pytest.mark.parametrize("late", [1, 3 * MS, 100 * MS, 900 * MS, 5 * SECOND, 3600 * SECOND])
def test_a_stamp_that_goes_back_is_late_and_changes_nothing(rate: int, lockstep: bool, late: int) -> None:
    source = Source(rate, lockstep)
    source.go_on()
    for n in range(1, 4):
        last, lead = source.arrivals.last, source.stamp
        # A copy of an earlier message arrives between two others.
        assert source.send(later=-source.period - late, took=0) is Stamp.LATE
        source.stamp = lead
        assert source.arrivals.last == last
        assert source.arrivals.refused == n
        source.go_on(3)


@EACH_RATE
@pytest.mark.parametrize("ahead", [50 * MS, 5 * SECOND, 3600 * SECOND])
def test_one_stamp_ahead_of_its_sources_clock_changes_nothing(rate: int, ahead: int) -> None:
    source = Source(rate)
    source.go_on()
    assert source.send(later=ahead) is Stamp.AHEAD
    source.go_on()


@EACH_CLOCK
def test_a_repeated_stamp_is_detected(lockstep: bool) -> None:
    source = Source(lockstep=lockstep)
    source.go_on()
    source.stamp -= source.period
    assert source.send(took=0) is Stamp.REPEATED
    source.go_on()


@EACH_RATE
@pytest.mark.parametrize("set_by", [-900 * MS, -3600 * SECOND, 50 * MS, 5 * SECOND, 3600 * SECOND])
def test_a_clock_that_has_been_set_is_recognised_from_more_than_one_message(rate: int, set_by: int) -> None:
    source = Source(rate)
    source.go_on()
    source.stamp += set_by
    judged = [source.send() for _ in range(9)]
    detected = judged.index(Stamp.RESTARTED)
    assert 4 <= detected <= 6
    assert set(judged[:detected]) == {Stamp.LATE if set_by < 0 else Stamp.AHEAD}
    assert set(judged[detected + 1 :]) == {Stamp.NEW}
    assert source.arrivals.elapsed == (detected + 1) * source.period
    source.go_on()


@EACH_RATE
@pytest.mark.parametrize("silence", [0, 3 * SECOND])
@pytest.mark.parametrize("slower", [0.1, 1.0, 5.0])
def test_after_a_clock_change_the_elapsed_time_is_that_of_the_source(rate: int, silence: int, slower: float) -> None:
    source = Source(rate)
    took = round(slower * source.period)
    for _ in range(50):
        assert source.send(took=took) is Stamp.NEW
    source.stamp -= 3600 * SECOND
    source.now += silence
    messages = 1
    while source.send(took=took) is not Stamp.RESTARTED:
        messages += 1
    # The progress of its time during the silence is unknown.
    between = silence + took if silence else source.period
    assert source.arrivals.elapsed == between + (messages - 1) * source.period


def test_in_lockstep_a_restarted_source_repeats_its_message_until_it_is_accepted() -> None:
    source = Source(lockstep=True)
    source.go_on()
    source.stamp = 0
    assert source.send() is Stamp.LATE
    source.stamp -= source.period
    assert source.send() is Stamp.RESTARTED
    source.go_on()


@pytest.mark.parametrize("silence", [20 * MS, 500 * MS, 2 * SECOND, 3600 * SECOND])
def test_a_gap_on_both_clocks_is_accepted(silence: int) -> None:
    source = Source()
    source.go_on()
    source.stamp += silence
    assert source.send(took=silence) is Stamp.NEW
    source.go_on()


def test_messages_that_waited_while_the_receiver_did_not_run_are_used() -> None:
    source = Source()
    source.go_on()
    source.now += 300 * MS
    # Some of the messages in the middle were lost.
    for missing in (0, 20, 0, 200, 0):
        source.stamp += missing * MS
        assert source.send(took=1000) is Stamp.NEW
    source.go_on(5)


STALLS = [n * MS for n in (1, 5, 20, 71, 85, 99, 100, 150, 500, 1000, 2000, 10_000)]
ALL_RATES = [100, 250, 500, 1000, 2000]


def receive(source: Source, sent: list[tuple[int, int]]) -> list[Stamp]:
    """Judge messages given by when they were sent (source's clock) and when they arrive (receiver's), ns."""
    judged = []
    for stamp, now in sent:
        judged.append(source.arrivals.judge(EPOCH + stamp, now))
        if judged[-1].usable:
            source.arrivals.take(judged[-1], EPOCH + stamp, now)
    return judged


def delayed(rate: int, seconds: float, jitter: float, random: np.random.Generator) -> list[tuple[int, int]]:
    """Messages that arrive up to `jitter` periods after they were sent, in order."""
    sent = np.arange(round(seconds * rate)) * (SECOND // rate)
    arrive = np.maximum.accumulate(sent + (random.uniform(0.0, jitter, sent.size) * SECOND / rate).astype(np.int64))
    return list(zip(sent.tolist(), arrive.tolist(), strict=True))


@pytest.mark.parametrize("length", STALLS)
@pytest.mark.parametrize("rate", ALL_RATES)
def test_no_message_is_refused_after_a_stall_of_any_length(length: int, rate: int) -> None:
    for jitter, waited, oldest in itertools.product([0.0, 3.0], [1, 3, 100, 10**6], [True, False]):
        check_stall(length, rate, jitter, waited, oldest)


def check_stall(length: int, rate: int, jitter: float, waited: int, oldest: bool) -> None:
    """The messages of the stall that are not lost, so many of its oldest or newest, arrive together at its end."""
    random = np.random.default_rng(rate)
    began, end = 2 * SECOND, 2 * SECOND + length
    messages = delayed(rate, 2.0 + length / SECOND + 1.0, jitter, random)
    before, during, after = (
        [m for m in messages if m[1] < began],
        [m for m in messages if began <= m[1] < end],
        [m for m in messages if m[1] >= end],
    )
    kept = during[:waited] if oldest else during[-waited:]
    late = [(sent, end + 10_000 * n) for n, (sent, _) in enumerate(kept)]
    after = [(sent, max(now, late[-1][1] if late else 0)) for sent, now in after]
    source = Source()
    assert set(receive(source, [*before, *late, *after])) == {Stamp.NEW}
    # A clock that is set is recognised all the same.
    sent, now = after[-1]
    period = SECOND // rate
    ahead = [(sent + 5 * SECOND + n * period, now + n * period) for n in range(1, 13)]
    assert receive(source, ahead).index(Stamp.RESTARTED) <= max(4, 5 * MS // period + 1)


@pytest.mark.parametrize("rate", ALL_RATES)
@pytest.mark.parametrize("every", [0.1, 0.7])
def test_no_message_is_refused_on_a_machine_that_stalls_again_and_again(rate: int, every: float) -> None:
    """Stalls of 1 ms to nearly all of the time, in which messages wait or are lost."""
    random = np.random.default_rng(rate)
    messages, arrivals, free = delayed(rate, 20.0, 0.3, random), [], 0
    stalls = [
        (round(start * SECOND), round((start + random.uniform(0.001, 0.9 * every)) * SECOND))
        for start in np.arange(1.0, 20.0, every)
    ]
    for sent, now in messages:
        stalled = next((end for begin, end in stalls if begin <= now < end), 0)
        if stalled and random.uniform() < 0.5:
            continue
        free = max(free + 1, now, stalled)
        arrivals.append((sent, free))
    assert set(receive(Source(), arrivals)) == {Stamp.NEW}


@EACH_RATE
def test_the_longest_silence_between_two_messages_is_known(rate: int) -> None:
    source = Source(rate)
    source.go_on()
    assert source.arrivals.silence == source.period
    source.send(took=3 * SECOND)
    assert source.arrivals.silence == 3 * SECOND
    # Messages that are refused count as arrived, too.
    source.stamp -= 3600 * SECOND
    while source.send() is not Stamp.RESTARTED:
        pass
    assert source.arrivals.silence == source.period
    source.stamp -= 3600 * SECOND
    source.now += 3 * SECOND
    while source.send() is not Stamp.RESTARTED:
        pass
    assert source.arrivals.silence == 3 * SECOND + source.period


@pytest.mark.parametrize("drift", [-1e-4, 1e-4, 9.0], ids=["slow", "fast", "ten times as fast"])
def test_no_message_is_refused_because_clocks_drift_apart(drift: float) -> None:
    source = Source()
    for _ in range(20_000):
        assert source.send(took=round(source.period / (1.0 + drift))) is Stamp.NEW


def test_one_stamp_ahead_is_detected_even_if_simulated_time_is_slow() -> None:
    source = Source(rate=250)
    for _ in range(2000):
        assert source.send(took=5 * source.period) is Stamp.NEW
    assert source.send(later=5 * SECOND) is Stamp.AHEAD
    source.go_on()


@EACH_RATE
@pytest.mark.parametrize("jitter", [0.0, 0.3, 0.8])
def test_the_nominal_period_is_measured_whatever_the_jitter(rate: int, jitter: float) -> None:
    source, random = Source(rate), np.random.default_rng(1)
    nominal = source.period
    for _ in range(500):
        source.period = round(nominal * (1.0 + random.uniform(-jitter, jitter)))
        assert source.send() is Stamp.NEW
    assert abs(source.arrivals.period / nominal - 1.0) <= max(0.5 * jitter, 1e-9)


@pytest.mark.parametrize("epoch", [0, -3600 * SECOND, 3600 * SECOND], ids=["same", "behind", "ahead"])
def test_the_age_of_a_message_does_not_depend_on_the_clock_of_its_source(epoch: int) -> None:
    source = Source()
    system = EPOCH + epoch - source.now
    source.go_on()
    source.now += 7 * MS  # The delay of the last message.
    assert source.arrivals.age(source.now, source.now + system) == 7 * MS
