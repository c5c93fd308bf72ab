"""The fault matrix of the controller, for any number of joints; docs/faults.md describes it for users.

There are no processes and no ROS. A row is a fault around a controller that is called as in its node, and the expected
reaction. In every row, no torque exceeds a limit and every value is finite; a fault stays until it is reset; and when
the fault has gone, the torques are bit-identical to those before.
"""

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.testarms import TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, Count, controller_schema
from pidtsm_core.messages.arrivals import Arrivals, Stamp
from pidtsm_core.parameters.joints import JointOrder, MessageError
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

PAGE = Path(__file__).parents[5] / "docs" / "faults.md"
BYTES = ["`joint_states`: bytes that are not a message", "`reference`: bytes that are not a message"]
"""Rows of the page about messages that cannot be deserialized; tests/test_faults.py tests them."""
DAMPING = 20.0  # N m s/rad
MS = 1_000_000
SECOND = 1000 * MS
HOUR = 3600 * SECOND
SETTLED = 20  # ticks before a fault
UNDISTURBED = 100  # ticks
BASE: dict[str, Any] = {"stop.effort": "gravity_damping", "plausibility.velocity": 0.0, "limits.external_effort": 0.0}
"""A safe torque that can be predicted, and an arm that may jump and be held; the rest is tested in files of its own."""


class Rig:
    """A controller, called as in its node; the test provides its arm, its reference and its clock.

    Attributes:
        start: the reference, shape (joints,), rad or m.
        aside: 1 rad or 1 m for the first joint, the opposite for the next one, and so on.
        stamp: stamp of the last joint state, ns.
        tick: number of joint states since the motion began.
        referred: whether each joint state comes with a reference of the same stamp.
        logged: causes of rejected messages, changes of the status, and names of unusual stamps.
        lockstep: as in the node.
    """

    lockstep = False

    def __init__(self, arm: Arm) -> None:
        self.arm, self.start = arm, np.array(arm.start)
        self.aside = arm.alternating(1.0)
        self.controller = Controller(arm.values(controller_schema, BASE))
        self.stamp = 1_000_000 * SECOND
        self.tick = 0
        self.referred = True
        self.logged: list[str] = []
        self._arrivals, self._references = Arrivals(), Arrivals()
        self._now = 5 * SECOND
        self._order = JointOrder(arm.names)
        self._before: tuple[int, ...] | None = None

    def set(self, settings: dict[str, Any]) -> None:
        """Change parameters; those that are not given return to their defaults."""
        self.controller.set_parameters(self.arm.values(controller_schema, {**BASE, **settings}))

    def measured(self) -> Array:
        """Position of the arm at this tick: it swings slightly beside its reference."""
        return self.start + 0.005 * (1.0 - math.cos(0.02 * self.tick))

    def judge(self, arrivals: Arrivals, stamp: int) -> Stamp:
        judged = arrivals.judge(stamp, None if self.lockstep else self._now)
        if judged in (Stamp.LATE, Stamp.AHEAD):
            raise MessageError(judged.name.lower())
        return judged

    def send_state(
        self,
        position: Sequence[float] | Array,
        names: Sequence[str] | None = None,
        dt: int = MS,
        took: int = 0,
    ) -> bool:
        """Send a joint state dt (ns) after the last one, took (ns) from now; return whether it must be answered."""
        stamp = self.stamp + dt
        self._now += took
        try:
            judged = self.judge(self._arrivals, stamp)
            if judged.usable:
                order = self.arm.names if names is None else names
                self._order.read(order, array("d", position), "position", self.controller.position)
        except MessageError as error:
            self.logged.append(str(error))
            return False
        self._arrivals.take(judged, stamp, None if self.lockstep else self._now)
        if judged is not Stamp.NEW:
            self.logged.append(judged.name)
        if judged is Stamp.REPEATED:
            return False
        if judged is Stamp.RESTARTED:
            self.controller.set_clock(stamp, self._arrivals.elapsed)
            self._references.forget()
        self.stamp = stamp
        return True

    def send_reference(
        self,
        position: Sequence[float] | Array | None = None,
        names: Sequence[str] | None = None,
        dt: int = MS,
        velocity: float = 0.0,
    ) -> None:
        """Send a reference for a joint state dt (ns) after the last one."""
        names = self.arm.names if names is None else names
        position = self.start if position is None else position
        motion = np.zeros((3, self.arm.joints))
        rows = (position, [velocity] * len(position), [0.0] * len(position))
        try:
            judged = self.judge(self._references, self.stamp + dt)
            for row, values, fieldname in zip(motion, rows, ("position", "velocity", "acceleration"), strict=True):
                self._order.read(names, array("d", values), fieldname, row)
        except MessageError as error:
            self.logged.append(str(error))
            return
        self.controller.reference[:] = motion
        self._references.take(judged, self.stamp + dt, None if self.lockstep else self._now)

    def step(
        self,
        position: Sequence[float] | Array | None = None,
        dt: int = MS,
        names: Sequence[str] | None = None,
        desired: Sequence[float] | Array | None = None,
    ) -> Array:
        """Send a joint state dt (ns) after the last one; return its torque, valid until the next one."""
        self._now += dt
        if self.referred:
            self.send_reference(desired, names, dt)
        assert self.send_state(self.measured() if position is None else position, names, dt)
        self.controller.step(self.stamp, self._references.last)
        self.tick += 1
        return self.look()

    def look(self) -> Array:
        """Check and return the torque of the controller, and log the changes of its status."""
        controller = self.controller
        self.logged += [change.text for change in controller.changes(self._before)]
        self._before = controller.status
        assert np.isfinite(controller.signals).all()
        assert (np.abs(controller.effort) <= self.arm.limits).all()
        return controller.effort

    def drive(self, ticks: int) -> Array:
        """Return the torques of the next ticks."""
        return np.array([self.step().copy() for _ in range(ticks)])

    def check_undisturbed(self, since: int = 0) -> None:
        """Check that the torques of the next ticks are those without a fault, from the tick `since` on."""
        expected = undisturbed(self.arm)[since : since + SETTLED]
        np.testing.assert_array_equal(self.drive(SETTLED), expected)

    def begin(self) -> None:
        """Restart the source: the controller starts afresh."""
        self._arrivals.forget()
        self._references.forget()
        self.stamp -= 100 * SECOND
        self.controller.set_clock(self.stamp, 0)
        self.tick = 0

    def check_safe(self) -> None:
        """Check that the torque is the expected one of a controller that has stopped."""
        q, dq = self.controller.signals[[Signal.POSITION, Signal.VELOCITY]]
        limits = self.arm.limits
        expected = np.clip(self.arm.effort(q) - DAMPING * dq, -limits, limits)
        assert (np.abs(self.controller.effort - expected) <= 1e-12 * limits).all()


@cache
def undisturbed(arm: Arm) -> Array:
    """The torques without a fault, shape (UNDISTURBED, joints), N m."""
    efforts = Rig(arm).drive(UNDISTURBED)
    assert (np.abs(efforts) < arm.limits).all()
    return efforts


@dataclass(frozen=True)
class Row:
    """A fault of the controller's surroundings, and its reaction.

    Attributes:
        inject: causes the fault; the other attributes describe the controller afterwards.
        mode, fault, joint: its status; the joint is counted from 1, 0 means none.
        log: beginnings of the logged texts, except that of the reset of a fault.
        late: number of joint states that count as late.
        unnoticed: whether the torques are those without a fault.
        settings: parameters during the row.
    """

    inject: Callable[[Rig], object]
    mode: Mode = Mode.FOLLOWING
    fault: Fault = Fault.NO_FAULT
    joint: int = 0
    log: tuple[str, ...] = ()
    late: int = 0
    unnoticed: bool = False
    settings: dict[str, Any] = field(default_factory=dict)


# Unusable messages: values, names of joints, and the cause in the log.

NAN, INF = math.nan, math.inf
MANY = 10_000


def bad_messages(arm: Arm) -> dict[str, tuple[list[float], list[str], str]]:
    names, n = arm.names, arm.joints
    good, first, last = [0.2] * n, names[0], names[-1]
    return {
        "nan": ([*good[1:], NAN], names, f"position is not finite: {last}"),
        "infinite": ([-INF, *good[1:]], names, f"position is not finite: {first}"),
        "absurd": ([*good[1:], 1e6], names, f"position is absurd: {last}"),
        "too few values": (good[1:], names, f"position has {n - 1} values for {n} joints"),
        "too many values": ([*good, 0.2], names, f"position has {n + 1} values for {n} joints"),
        "no names": (good, [], f"joints {', '.join(names)} are missing"),
        "a joint missing": (good[1:], names[:-1], f"joints {last} are missing"),
        "an unknown joint": (good, [*names[:-1], "elbow"], f"unknown joints elbow, missing {last}"),
        "a joint twice": ([0.2] * max(n, 2), [first] * max(n, 2), "a joint is named twice"),
        "oversized": ([0.2] * MANY, [f"link{i}" for i in range(MANY)], "unknown joints link0, link1, "),
    }


def bad_row(topic: str, values: list[float], names: list[str], reason: str) -> Row:
    def inject(rig: Rig) -> None:
        if topic == "joint_states":
            assert not rig.send_state(values, names)
        else:
            rig.send_reference(values, names)
        rig.step()

    return Row(inject, log=(reason,), unnoticed=True)


def lose(samples: int) -> Callable[[Rig], object]:
    return lambda rig: rig.step(dt=(samples + 1) * MS)


def permute(rig: Rig) -> None:
    for _ in range(10):
        rig.step(rig.measured()[::-1], names=rig.arm.names[::-1], desired=rig.start[::-1])


def repeat(rig: Rig) -> None:
    assert not rig.send_state(rig.aside, dt=0)
    rig.step()


def repeat_in_lockstep(rig: Rig) -> None:
    rig.lockstep = True
    repeat(rig)


def copy(dt: int) -> Callable[[Rig], object]:
    """Send single joint states and references whose stamps are wrong by dt (ns)."""

    def inject(rig: Rig) -> None:
        for _ in range(3):
            assert not rig.send_state(rig.aside, dt=dt)
            rig.send_reference(rig.aside, dt=dt)
            rig.step()

    return inject


def set_clock(dt: int) -> Callable[[Rig], object]:
    """Set the clock of the source of joint states while the arm continues its motion."""

    def inject(rig: Rig) -> None:
        rig.referred = False
        before = rig.controller.effort.copy()
        for k in range(1, 9):
            if rig.send_state(rig.measured(), dt=dt + k * MS, took=MS):
                break
        rig.tick += k
        rig.controller.step(rig.stamp, rig._references.last)
        assert (np.abs(rig.look() - before) < 0.1 * rig.arm.limits).all()

    return inject


def crowd(rig: Rig) -> None:
    for _ in range(10):
        rig.step(dt=1)


def fall_silent(rig: Rig) -> None:
    """Send no joint state: the watchdog acts without one."""
    rig.controller.stop(Fault.STATE_STALE, 600 * MS)
    rig.look()
    rig.check_safe()
    rig.step()


def restart(rig: Rig) -> None:
    """Restart the controller while the arm moves."""
    rig.tick = 0
    rig.check_undisturbed()


def reset_by_rehearsal(rig: Rig) -> None:
    rig.step(dt=21 * MS)
    while rig.controller.fault:
        rig.check_safe()
        rig.tick = 0
        rig.step()
    rig.check_undisturbed(since=1)


def measure_far_off(rig: Rig) -> None:
    before = rig.controller.effort.copy()
    assert (np.abs(rig.step(1000.0 * rig.aside) - before) < 0.02 * rig.arm.limits).all()
    assert rig.controller.state.counts[Count.IMPLAUSIBLE] == 1
    rig.step()


def jump(rig: Rig) -> None:
    """Let the reference jump while the arm is held where it is."""
    jumped = rig.start + 0.8 * rig.aside
    assert any((np.abs(rig.step(desired=jumped)) == rig.arm.limits).any() for _ in range(500))


def lose_references(rig: Rig, samples: int = 101) -> None:
    rig.referred = False
    rig.drive(samples)


def lose_some_references(rig: Rig) -> None:
    lose_references(rig, 50)
    rig.referred = True
    rig.step()


def refer_late(rig: Rig) -> None:
    lose_references(rig, 98)
    for i in range(50):
        if i % 5 == 0:
            rig.send_reference(dt=-98 * MS)
        rig.step()


def refer_from_tomorrow(rig: Rig) -> None:
    rig.send_reference(dt=HOUR, velocity=0.1)
    rig.step()


def leave(joint: int, by: float) -> Callable[[Rig], object]:
    """Find a joint, counted from 0, beside the reference, away from zero (rad or m)."""

    def inject(rig: Rig) -> None:
        position = rig.start.copy()
        position[joint] += math.copysign(by, position[joint])
        rig.step(position)

    return inject


def stay_far_off(rig: Rig) -> None:
    for _ in range(6):
        rig.step(rig.start + rig.aside)


def live(rig: Rig, held: Array, **push: Any) -> Array:
    """Release the arm at `held`, or push it for 0.1 s, and wait until it rests at its reference again.

    Returns:
        The torques, shape (samples, joints), N m.
    """
    changes = {"initial_position": held.tolist(), "disturbance.name": "none", "push.duration": 0.1}
    robot = SimulatedRobot(rig.arm.values(simulator_schema, {**changes, **push}))
    arm, efforts = robot.state.arm, [rig.controller.effort.copy()]
    for sample in range(8000):
        robot.act(sample, True, efforts[-1])
        efforts.append(rig.step(arm.position).copy())
        if sample > 100 and max(np.abs(arm.position - rig.start).max(), np.abs(arm.derivatives[0]).max()) < 0.01:
            rig.tick = 0
            return np.array(efforts)
    pytest.fail("the arm does not come back to its reference")


def saturate(rig: Rig) -> None:
    """Hold the arm for 5 s at the limits of all torques, then release it."""
    held, signals = rig.start + rig.aside, rig.controller.signals
    for k in range(5000):
        rig.step(held)
        if k == 100:
            gain = signals[Signal.ADAPTIVE_GAIN].copy()
        assert k < 100 or (signals[Signal.SATURATED] == Limited.EFFORT).all()
    # The gain does not adapt to errors that the law did not cause.
    np.testing.assert_array_equal(signals[Signal.ADAPTIVE_GAIN], gain)
    live(rig, held)


def hold_back(rig: Rig) -> None:
    """Push the arm, so that the law demands more than the rate limit allows."""
    push = rig.arm.effort(rig.start, ddq=7.5 * rig.aside) - rig.arm.effort(rig.start)
    efforts = live(rig, rig.measured(), **{"push.effort": push.tolist()})
    assert rig.controller.state.counts[Count.AT_RATE_LIMIT] > 0
    assert (np.abs(np.diff(efforts, axis=0)) <= 3.0 * rig.arm.limits * 1e-3 + 1e-9).all()


def cannot_keep_up(rig: Rig) -> None:
    """Pull the arm aside while the rate limit keeps the torque from following."""
    for _ in range(1000):
        rig.step(rig.start + 0.3 * rig.aside)
        if rig.controller.fault:
            return
    pytest.fail("the controller does not see that the limit is too tight")


def be_held(rig: Rig) -> None:
    """Take the arm aside, and hold it there for half a second."""
    for k in range(1000):
        rig.step(rig.start + min(k / 500, 1.0) * rig.aside)


def be_locked(rig: Rig) -> None:
    """Stay in place, bit by bit, while the reference of the first joint moves away."""
    place, away = rig.measured(), np.zeros(rig.arm.joints)
    for k in range(2000):
        away[0] = math.copysign(min(k / 1000, 1.0), rig.aside[0])
        rig.step(place, desired=rig.start + away)
        if rig.controller.fault:
            return
    pytest.fail("the controller does not notice that the arm does not move")


JUDGED = {"plausibility.velocity": 20.0}
LOST = "stopped: no joint state for {} s; safe torque until ~/reset_fault is called"
RANGE = "its position limits (limits.*_position)"
BEYOND = "stopped: {} is beyond {}; safe torque until ~/reset_fault is called"
TOO_TIGHT = (
    "stopped: limits.effort_rate is too tight for the motion of the arm; safe torque until ~/reset_fault is called"
)
FAR_OFF = "stopped: {} has implausible measurements (plausibility.velocity); safe torque until ~/reset_fault"
NO_EFFECT = "stopped: the torque has no effect on {}: it is locked or not powered, another controller drives it, or"
RESET = "fault reset"
FOLLOWS_AGAIN = ("holding position: there is no reference", "following the reference")


def stopped(fault: Fault, log: str, joint: int = 0, **others: Any) -> dict[str, Any]:
    return {"mode": Mode.STOPPED, "fault": fault, "joint": joint, "log": (log,), **others}


def stale(seconds: str, **others: Any) -> dict[str, Any]:
    return stopped(Fault.STATE_STALE, LOST.format(seconds), **{"late": 1, **others})


OF_TIMES = {
    "1 joint state lost": Row(lose(1)),
    "5 joint states lost": Row(lose(5), late=1),
    "20 joint states lost": Row(lose(20), **stale("0.021")),
    "1000 joint states lost": Row(lose(1000), **stale("1")),
    "a gap of 10 ms": Row(lambda rig: rig.step(dt=10 * MS), late=1),
    "silence": Row(fall_silent, **stale("0.6", late=0)),
    "a stamp twice (dt = 0)": Row(repeat, log=("REPEATED",), unnoticed=True),
    "a stamp twice in lockstep": Row(repeat_in_lockstep, log=("REPEATED",), unnoticed=True),
    "stamps 1 ns apart": Row(crowd),
    "a stamp that goes back by 3 ms": Row(copy(-3 * MS), log=("late",) * 6, unnoticed=True),
    "a stamp that goes back by 0.9 s": Row(copy(-900 * MS), log=("late",) * 6, unnoticed=True),
    "a stamp that goes back by 1 h": Row(copy(-HOUR), log=("late",) * 6, unnoticed=True),
    "one stamp ahead by 5 s": Row(copy(5 * SECOND), log=("ahead",) * 6, unnoticed=True),
    "clock set back by 1 h": Row(
        set_clock(-HOUR), Mode.HOLDING, late=1, log=(*("late",) * 5, "RESTARTED", *FOLLOWS_AGAIN)
    ),
    "clock set ahead by 1 h": Row(
        set_clock(HOUR), Mode.HOLDING, late=1, log=(*("ahead",) * 5, "RESTARTED", *FOLLOWS_AGAIN)
    ),
    "controller restarted": Row(restart, settings={"rehearsal.restart": SETTLED * 1e-3}),
    "fault reset rehearsed": Row(
        reset_by_rehearsal,
        log=(LOST.format("0.021"), RESET),
        late=1,
        settings={"rehearsal.reset_fault": 0.1},
    ),
}


def of_messages(arm: Arm) -> dict[str, Row]:
    return {
        f"`{topic}`: {what}": bad_row(topic, *message)
        for topic in ("joint_states", "reference")
        for what, message in bad_messages(arm).items()
    }


OF_REFERENCES = {
    "joints in another order": Row(permute, unnoticed=True),
    "`reference` lost for 50 ms": Row(lose_some_references, unnoticed=True),
    "`reference` lost for more than 100 ms": Row(
        lose_references,
        mode=Mode.HOLDING,
        log=("holding position: the reference is 0.101 s old", "following the reference"),
    ),
    "`reference` delayed by about 100 ms": Row(
        refer_late,
        mode=Mode.HOLDING,
        log=("holding position: the reference is 0.10", "following the reference"),
    ),
    "`reference` ahead by 1 h": Row(refer_from_tomorrow, log=("ahead",)),
    "`reference` jumps by 0.8 rad": Row(jump),
}


def of_limits(arm: Arm) -> dict[str, Row]:
    n, (first, *_), (*_, last) = arm.joints, arm.names, arm.names
    limits = arm.limits.tolist()
    most = np.abs(arm.start) + 0.3
    position = {"limits.min_position": (-most).tolist(), "limits.max_position": most.tolist()}
    return {
        "a measurement far off": Row(measure_far_off, settings=JUDGED),
        "6 measurements far off": Row(
            stay_far_off, **stopped(Fault.MEASUREMENT, FAR_OFF.format(last), n), settings=JUDGED
        ),
        "the torque has no effect": Row(be_locked, **stopped(Fault.NO_EFFECT, NO_EFFECT.format(first), 1)),
        "saturation for 5 s": Row(saturate, settings={**arm.gains(), "limits.effort": arm.weak_limits(6.5).tolist()}),
        "`limits.effort_rate` holds the torque back": Row(
            hold_back, settings={"limits.effort_rate": [3.0 * limit for limit in limits]}
        ),
        "`limits.effort_rate` too tight": Row(
            cannot_keep_up,
            **stopped(Fault.EFFORT_RATE_LIMIT, TOO_TIGHT),
            settings={"limits.effort_rate": [0.05 * limit for limit in limits]},
        ),
        "beyond `limits.min_position` or `limits.max_position`": Row(
            leave(0, 0.4),
            **stopped(Fault.POSITION_LIMIT, BEYOND.format(first, RANGE), 1),
            settings=position,
        ),
        "beyond `limits.velocity`": Row(
            leave(0, 0.1),
            **stopped(Fault.VELOCITY_LIMIT, BEYOND.format(first, "limits.velocity"), 1),
            settings={"limits.velocity": 2.0},
        ),
        "beyond `limits.tracking_error`": Row(
            leave(n - 1, 0.15),
            **stopped(Fault.TRACKING_LIMIT, BEYOND.format(last, "limits.tracking_error"), n),
            settings={"limits.tracking_error": 0.1},
        ),
        "beyond `limits.external_effort`": Row(
            be_held,
            log=("a joint is beyond limits.external_effort",),
            settings={"limits.external_effort": [0.02 * limit for limit in limits]},
        ),
        "the same with `limits.external_effort_action: stop`": Row(
            be_held,
            **stopped(Fault.EXTERNAL_EFFORT_LIMIT, BEYOND.format(last, "limits.external_effort"), n),
            settings={
                "limits.external_effort": [0.0] * (n - 1) + [0.02 * limits[-1]],
                "limits.external_effort_action": "stop",
            },
        ),
        "beyond a limit that only warns": Row(
            leave(0, 0.4),
            log=(f"a joint is beyond {RANGE}",),
            settings={**position, "limits.position_action": "warn"},
        ),
    }


@cache
def rows(arm: Arm) -> dict[str, Row]:
    return {**OF_TIMES, **of_messages(arm), **OF_REFERENCES, **of_limits(arm)}


ROWS = list(rows(TWO_LINK))


@pytest.mark.parametrize("name", ROWS)
def test_a_fault_has_the_documented_reaction(arm: Arm, name: str) -> None:
    row, rig = rows(arm)[name], Rig(arm)
    controller = rig.controller
    rig.set(row.settings if any(n.startswith("rehearsal") for n in row.settings) else {})
    rig.check_undisturbed()
    rig.set(row.settings)
    assert not rig.logged
    row.inject(rig)
    expected = [row.mode, row.fault, row.joint]
    assert list(controller.status[: Status.VIOLATIONS]) == expected
    for _ in range(5):
        if row.mode == Mode.STOPPED:
            rig.check_safe()
        if row.unnoticed:
            np.testing.assert_array_equal(controller.effort, undisturbed(arm)[rig.tick - 1])
        rig.step()
        assert list(controller.status[: Status.VIOLATIONS]) == expected, "latched"
    assert controller.state.counts[Count.LATE] == row.late

    # The fault has gone.
    rig.referred = True
    rig.step()
    assert controller.fault == row.fault
    if row.fault:
        assert not controller.refusal(True)
        controller.reset_fault()
        rig.look()
        rig.tick = 0
    else:
        assert controller.status[Status.MODE] == Mode.FOLLOWING
    log = (*row.log, RESET) if row.fault else row.log
    assert len(rig.logged) == len(log), rig.logged
    for text, begin in zip(rig.logged, log, strict=True):
        assert text.startswith(begin)
    rig.set({})
    if not row.fault:
        rig.begin()
    rig.check_undisturbed()
    assert controller.status[Status.MODE] == Mode.FOLLOWING


def on_the_page(section: str) -> list[str]:
    """The first column of the table in a section."""
    text = PAGE.read_text(encoding="utf-8").partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    return [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")][2:]


@pytest.mark.skipif(not PAGE.is_file(), reason="the page is not beside this package")
def test_the_page_has_these_rows() -> None:
    bad = [f"`{topic}`: {what}" for topic in ("joint_states", "reference") for what in on_the_page("Bad messages")]
    assert on_the_page("The controller") == [name for name in ROWS if name not in bad]
    assert [name for name in bad if name not in BYTES] == [name for name in ROWS if name in bad]
    assert set(BYTES) <= set(bad)
