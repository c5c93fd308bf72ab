"""The fault matrix, where nothing depends on timing: what the real nodes of several arms do when something goes wrong.

A row is a fault, injected into a real node, and the reaction expected; docs/faults.md tells the same to users. Every
row ends with a node that lives, that has published nothing beyond a limit and nothing that is not finite, and that does
bit by bit what it did before, once the fault has gone.

All rows of the controller are judged without processes, in the test/control/test_faults.py of pidtsm_core. Here are
those that say whether the node hands on what happens, and what it alone does.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from support.rig import MS, SECOND, ControllerRig, Rigs, SimulatorRig, document_rows, safe_effort
from support.testarms import CRANE, PANDA, Arm

from pidtsm_core.experiment.node_parameters import controller_node_schema
from pidtsm_msgs.msg import ControllerState

PAGE = Path(__file__).parents[1] / "docs" / "faults.md"
SETTLED = 20  # ticks before a fault
FOLLOWING, HOLDING, STOPPED = ControllerState.FOLLOWING, ControllerState.HOLDING, ControllerState.STOPPED

LOCKSTEP: dict[str, Any] = {"reference.match": "stamp"}
LATEST: dict[str, Any] = {"watchdog.state_stop": 3600.0}
"""A controller that takes the newest reference; a machine that stalls is no fault here, nor other rows meanwhile."""
ARM: dict[str, Arm] = {"stamp": PANDA, "latest": CRANE}
"""Of the controller, by `reference.match`; nodes with the two-link arm are in the other tests."""
SUMMARIES = {
    FOLLOWING: None,
    HOLDING: (DiagnosticStatus.WARN, "holding position: the reference is missing or too old"),
    STOPPED: (DiagnosticStatus.ERROR, "stopped by a fault; call ~/reset_fault to continue"),
}


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rigs]:
    rigs = Rigs(tmp_path_factory.mktemp("rigs"))
    yield rigs
    rigs.close()


@dataclass(frozen=True)
class Row:
    """A fault of the controller's surroundings, and its reaction.

    Attributes:
        inject: the fault; returns the controller's first state under it.
        mode: of that state.
        fault: of that state.
        joint: that caused the fault, counted from 1; 0: none.
        log: how the lines begin that the fault brings about.
        rejected: number of messages that are rejected.
        late: number of joint states that are called late.
        unnoticed: the torques are those of a row without a fault.
        settings: parameters during the row.
        node: parameters of the node.
    """

    inject: Callable[[ControllerRig], ControllerState]
    mode: int = FOLLOWING
    fault: int = ControllerState.NO_FAULT
    joint: int = 0
    log: tuple[str, ...] = ()
    rejected: int = 0
    late: int = 0
    unnoticed: bool = False
    settings: dict[str, Any] = field(default_factory=dict)
    node: dict[str, Any] = field(default_factory=lambda: LOCKSTEP)


# Messages that no node can use: values for the joints named, and the cause that the log gives.

NAN, INF = math.nan, math.inf
MANY = 10_000
BAD = [
    "nan",
    "infinite",
    "absurd",
    "too few values",
    "too many values",
    "no names",
    "a joint missing",
    "an unknown joint",
    "a joint twice",
    "oversized",
]


def bad_message(what: str, arm: Arm) -> tuple[list[float], list[str], str]:
    names, n = arm.names, arm.joints
    good, first, last = [0.2] * n, names[0], names[-1]
    return {
        "nan": ([*good[1:], NAN], names, f"is not finite: {last}"),
        "infinite": ([-INF, *good[1:]], names, f"is not finite: {first}"),
        "absurd": ([*good[1:], 1e6], names, f"is absurd: {last}"),
        "too few values": (good[1:], names, f"has {n - 1} values for {n} joints"),
        "too many values": ([*good, 0.2], names, f"has {n + 1} values for {n} joints"),
        "no names": (good, [], f"joints {', '.join(names)} are missing"),
        "a joint missing": (good[1:], names[:-1], f"joints {last} are missing"),
        "an unknown joint": (good, [*names[:-1], "hand"], f"unknown joints hand, missing {last}"),
        "a joint twice": (good, [first] * n, "a joint is named twice"),
        "oversized": ([0.2] * MANY, [f"link{i}" for i in range(MANY)], "unknown joints link0, link1, "),
    }[what]


def cause(topic: str, fieldname: str, reason: str) -> str:
    """The line of the log for a bad message."""
    return f"rejected {topic}: {fieldname + ' ' if reason.startswith(('is', 'has')) else ''}{reason}"


def bad_row(topic: str, what: str) -> Row:
    reason = bad_message(what, ARM["stamp"])[2]

    def inject(rig: ControllerRig) -> ControllerState:
        values, names, _ = bad_message(what, rig.arm)
        publisher, make = {
            "joint_states": (rig.joint_states, rig.joint_state),
            "reference": (rig.references, rig.reference),
        }[topic]
        for i in range(2):
            # Two that differ, of one cause.
            publisher.publish(make([value + i for value in values], names))
        return rig.step()

    return Row(inject, log=(cause(topic, "position", reason),), rejected=2, unnoticed=True)


def no_message(topic: str) -> Row:
    """Bytes that are not a message."""

    def inject(rig: ControllerRig) -> ControllerState:
        publisher = rig.joint_states if topic == "joint_states" else rig.references
        for _ in range(2):
            publisher.publish(bytes([0, 1, 0, 0, 7]))
        return rig.step()

    return Row(inject, log=(f"rejected {topic}: ",), rejected=2, unnoticed=True)


def lose(samples: int) -> Callable[[ControllerRig], ControllerState]:
    return lambda rig: rig.step(dt=(samples + 1) * MS)


def repeat(rig: ControllerRig) -> ControllerState:
    rig.joint_states.publish(rig.joint_state(rig.measured(), dt=0))
    return rig.step()


def ask_again(rig: ControllerRig) -> ControllerState:
    commands = rig.watch.heard["joint_commands"]
    count = len(commands)
    rig.joint_states.publish(rig.joint_state(rig.measured(), dt=0))
    rig.testbed.spin_until(lambda: len(commands) > count, "the answer once more")
    assert commands[-1] == commands[-2]
    return rig.step()


def go_back(rig: ControllerRig) -> ControllerState:
    """One stamp, and then another: nothing that goes on."""
    for dt in (-900 * MS, -3 * MS):
        rig.joint_states.publish(rig.joint_state([1.0] * rig.arm.joints, dt=dt))
        state = rig.step()
    return state


def run_ahead(rig: ControllerRig) -> ControllerState:
    rig.joint_states.publish(rig.joint_state([1.0] * rig.arm.joints, dt=5 * SECOND))
    rig.references.publish(rig.reference([1.0] * rig.arm.joints, dt=5 * SECOND))
    return rig.step()


def lose_references(rig: ControllerRig) -> ControllerState:
    rig.referred = False
    for _ in range(101):
        state = rig.step()
    return state


def check_safe(rig: ControllerRig, effort: Any, state: ControllerState) -> None:
    """The torque is that of a controller that has stopped in this state."""
    assert (np.abs(np.array(effort) - safe_effort(state, rig.arm)) <= 1e-9 * rig.arm.limits).all()


def stray(rig: ControllerRig) -> ControllerState:
    return rig.step([rig.start[0] + 0.15, *rig.start[1:]])


def fall_silent(rig: ControllerRig) -> ControllerState:
    """No joint state: the watchdog needs none to act."""
    heard = rig.watch.heard["joint_commands"]
    count = len(heard)
    rig.testbed.spin_until(lambda: len(heard) > count, "the safe torque")
    check_safe(rig, rig.watch.last("joint_commands").effort, rig.watch.last("controller/state"))
    return rig.step()


LOST = "stopped: no joint state for {} s; safe torque until ~/reset_fault is called"
RESET = "fault reset"


ROWS = {
    "20 joint states lost": Row(
        lose(20), mode=STOPPED, fault=ControllerState.STATE_STALE, log=(LOST.format("0.021"), RESET), late=1
    ),
    "silence": Row(
        fall_silent,
        mode=STOPPED,
        fault=ControllerState.STATE_STALE,
        log=(LOST.partition("{")[0], RESET),
        settings={"watchdog.state_stop": 0.5},
        node=LATEST,
    ),
    "a stamp twice (dt = 0)": Row(
        repeat,
        log=("rejected joint_states: repeated: the stamp equals that of the previous message",),
        rejected=1,
        unnoticed=True,
        node=LATEST,
    ),
    "a stamp twice in lockstep": Row(ask_again, unnoticed=True),
    "a stamp that goes back by 0.9 s": Row(
        go_back, log=("rejected joint_states: late: the stamp is older than",), rejected=2, unnoticed=True
    ),
    "one stamp ahead by 5 s": Row(
        run_ahead,
        log=("rejected joint_states: ahead: the stamp is ahead of", "rejected reference: ahead: the stamp is ahead of"),
        rejected=2,
        unnoticed=True,
        node=LATEST,
    ),
    "`joint_states`: nan": bad_row("joint_states", "nan"),
    "`joint_states`: bytes that are not a message": no_message("joint_states"),
    "`reference`: a joint missing": bad_row("reference", "a joint missing"),
    "`reference`: bytes that are not a message": no_message("reference"),
    "`reference` lost for more than 100 ms": Row(
        lose_references,
        mode=HOLDING,
        log=("holding position: the reference is 0.101 s old", "following the reference"),
        node=LATEST,
    ),
    "beyond `limits.tracking_error`": Row(
        stray,
        mode=STOPPED,
        fault=ControllerState.TRACKING_LIMIT,
        joint=1,
        log=(
            f"stopped: {PANDA.names[0]} is beyond limits.tracking_error; safe torque until ~/reset_fault is called",
            RESET,
        ),
        settings={"limits.tracking_error": 0.1, "limits.external_effort": 0.0},
    ),
}
"""Of the table of the controller."""


@pytest.mark.parametrize("name", ROWS)
def test_the_controller(rigs: Rigs, name: str) -> None:
    row = ROWS[name]
    arm = ARM[row.node.get("reference.match", "latest")]
    rig: ControllerRig = rigs.get(ControllerRig, row.node, arm=arm)
    with rig.row():
        undisturbed = rig.undisturbed
        rig.says()
        rig.begin()
        np.testing.assert_array_equal(rig.drive(SETTLED), undisturbed[:SETTLED])
        rig.check_log((f"stopped: {arm.names[0]} is beyond its position limits (limits.*_position)", RESET))
        rig.testbed.set("controller", row.settings)
        state = row.inject(rig)
        assert (state.mode, state.fault, state.fault_joint) == (row.mode, row.fault, row.joint)
        for _ in range(5):
            if row.mode == STOPPED:
                check_safe(rig, state.effort, state)
            if row.unnoticed:
                np.testing.assert_array_equal(state.effort, undisturbed[rig.tick - 1])
            state = rig.step()
            assert (state.mode, state.fault) == (row.mode, row.fault), "latched"
        rig.rejected += row.rejected
        rig.late += row.late
        report = rig.reports()
        counted = {pair.key: float(pair.value) for pair in report.values}
        assert counted["messages rejected since the start"] == rig.rejected
        assert counted["late joint states since activation"] == rig.late
        if summary := SUMMARIES[row.mode]:
            assert (report.level, report.message) == summary

        # The fault has gone.
        rig.referred = True
        if row.fault:
            assert rig.reset().success
        else:
            assert rig.follow().fault == ControllerState.NO_FAULT
        rig.check_log(row.log)
        defaults = arm.values(controller_node_schema, row.node)
        rig.testbed.set("controller", {name: defaults[name] for name in row.settings})
        if not row.fault:
            assert not rig.reset().success, "there was no fault"
            rig.begin()
        np.testing.assert_array_equal(rig.drive(SETTLED), undisturbed[:SETTLED])
        assert rig.follow().fault == ControllerState.NO_FAULT


# The simulator.


@dataclass(frozen=True)
class SimulatorRow:
    """Something wrong with the commands; attributes as those of `Row`."""

    inject: Callable[[SimulatorRig], object]
    log: tuple[str, ...] = ()
    rejected: int = 0


def bad_command(what: str) -> SimulatorRow:
    values, names, reason = bad_message(what, CRANE)

    def inject(rig: SimulatorRig) -> None:
        for i in range(2):
            rig.commands.publish(rig.command([value + i for value in values], names))

    return SimulatorRow(inject, (cause("joint_commands", "effort", reason),), 2)


SIMULATOR_ROWS = {
    **{f"`joint_commands`: {what}": bad_command(what) for what in BAD},
    "`joint_commands`: bytes that are not a message": SimulatorRow(
        lambda rig: rig.commands.publish(bytes([0, 1, 0, 0, 7])), ("rejected joint_commands: ",), 1
    ),
    "a command for a joint state never sent": SimulatorRow(
        lambda rig: rig.commands.publish(rig.command(sample=rig.sample + 1)),
        ("rejected joint_commands: no joint state with this stamp was sent",),
        1,
    ),
    "a second command for a joint state": SimulatorRow(
        lambda rig: rig.commands.publish(rig.command([0.0] * rig.arm.joints, sample=rig.sample - 1)),
        ("ignored joint_commands: a command for this or a later joint state was used",),
    ),
    "a command beyond the limits": SimulatorRow(lambda rig: rig.step([10.0 * effort for effort in rig.effort])),
    "commands in another order": SimulatorRow(lambda rig: rig.step(rig.effort[::-1], rig.arm.names[::-1])),
}


@pytest.mark.parametrize("name", SIMULATOR_ROWS)
def test_the_simulator(rigs: Rigs, name: str) -> None:
    row = SIMULATOR_ROWS[name]
    rig: SimulatorRig = rigs.get(SimulatorRig, arm=CRANE)
    with rig.row():
        rig.step()
        rig.says()
        row.inject(rig)
        rig.rejected += row.rejected
        for _ in range(5):
            rig.step()
        counted = {pair.key: float(pair.value) for pair in rig.reports().values}
        assert counted["messages rejected since the start"] == rig.rejected
        rig.check_log(row.log)


def test_the_page_has_these_rows() -> None:
    bad = document_rows(PAGE, "Bad messages")
    of_the_simulator = [f"`joint_commands`: {what}" for what in bad] + document_rows(PAGE, "The simulator")
    assert of_the_simulator == list(SIMULATOR_ROWS)
    of_the_controller = [f"`{topic}`: {what}" for topic in ("joint_states", "reference") for what in bad]
    assert set(ROWS) <= {*of_the_controller, *document_rows(PAGE, "The controller")}
