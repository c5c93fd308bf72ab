"""The controller as an object: stamps, state, parameters, and when it must not move the arm."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Clock, Controller, controller_schema
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Array, resolve
from pidtsm_core.signals import Fault, Mode, Status

MS = 1_000_000
SECOND = 1000 * MS
START = 5 * SECOND
RECEIVED = ("measured", "applied", "received", "reference")
"""Arrays that are written before a step."""
EACH = pytest.mark.parametrize("law", LAWS.names)
EVERYTHING = {
    "limits.effort_rate": 300.0,
    "limits.tracking_error": 0.05,
    "activation.blend": 0.02,
    "rehearsal.reset_fault": 0.08,
    "rehearsal.restart": 0.12,
}


def controller_of(**changes: object) -> Controller:
    """A controller; parameter names with two underscores instead of the dot."""
    return Controller(resolve(controller_schema, {n.replace("__", "."): v for n, v in changes.items()}, 2))


def drive(controller: Controller, samples: range = range(200)) -> Array:
    """Drive an arm that moves away and back, with one gap in its joint states and one in its references.

    Returns:
        Signals and status of each sample, shape (samples, len(Signal) + len(Status), joints).
    """
    rows = []
    for k in samples:
        controller.position[:] = 0.2 - 0.3 * np.sin(0.1 * k), 0.1 * np.cos(0.1 * k)
        controller.reference[0] = 0.2, 0.1
        stamp = START + k * MS + (30 * MS if k >= 150 else 0)
        controller.step(stamp, -1 if 20 <= k < 30 else stamp)
        rows.append(np.vstack([controller.signals, np.transpose([controller.status] * 2)]))
    return np.array(rows)


@EACH
def test_a_run_after_reset_is_bit_for_bit_the_first(law: str) -> None:
    controller = controller_of(law__name=law, **EVERYTHING)
    first = drive(controller)
    assert controller.fault
    controller.reset()
    for name, array in controller.state._asdict().items():
        assert name in RECEIVED or not array.any(), name
    np.testing.assert_array_equal(drive(controller), first)
    np.testing.assert_array_equal(drive(controller_of(law__name=law, **EVERYTHING)), first)


@EACH
def test_new_parameters_keep_the_state(law: str) -> None:
    controller = controller_of(law__name=law, **EVERYTHING)
    expected = drive(controller_of(law__name=law, **EVERYTHING))
    drive(controller, range(100))
    kept = [array.copy() for array in controller.state]
    controller.set_parameters(resolve(controller_schema, {"law.name": law, "limits.effort": 1e-3}, 2))
    for before, now in zip(kept, controller.state, strict=True):
        np.testing.assert_array_equal(now, before)
    controller.set_parameters(resolve(controller_schema, {"law.name": law, **EVERYTHING}, 2))
    np.testing.assert_array_equal(drive(controller, range(100, 200)), expected[100:])


def test_compiling_leaves_the_initial_state() -> None:
    controller = controller_of()
    controller.compile()
    np.testing.assert_array_equal(drive(controller), drive(controller_of()))


@pytest.mark.parametrize("later", [-3600 * SECOND, 5 * SECOND])
@pytest.mark.parametrize("moved", [False, True])
def test_after_a_clock_change_only_an_arm_that_has_moved_starts_afresh(loop_of: Any, later: int, moved: bool) -> None:
    loop = loop_of()
    loop.go_on(2000)
    controller = loop.controller
    answered, before = controller.clock(Clock.ANSWERED), controller.effort.copy()
    controller.position[:] = loop.robot.state.arm.position + (1.0 if moved else 0.0)
    stamp = controller.clock(Clock.LAST) + later
    controller.set_clock(stamp, MS)
    controller.step(stamp, -1)
    assert controller.fault == Fault.NO_FAULT
    assert controller.status[Status.MODE] == Mode.HOLDING
    assert controller.clock(Clock.ANSWERED) == (1 if moved else answered + 1)
    assert moved or np.abs(controller.effort - before).max() < 10.0


@pytest.mark.parametrize(
    ("position", "referred", "reason"),
    [
        ((0.2, -0.1), True, ""),
        ((0.69, -0.1), True, ""),
        ((0.2, 0.5), True, "joint2 is 0.6 rad from its reference (activation.distance 0.5)"),
        ((-0.9, 0.5), True, "joint1 is 1.1 rad from its reference (activation.distance 0.5)"),
        ((-0.9, 0.5), False, ""),
    ],
)
def test_an_arm_far_from_its_reference_must_not_be_moved(
    position: tuple[float, float], referred: bool, reason: str
) -> None:
    controller = controller_of(activation__distance=0.5)
    controller.position[:], controller.reference[0] = position, (0.2, -0.1)
    assert controller.refusal(referred) == reason


@pytest.mark.parametrize("referred", [True, False])
def test_a_rehearsed_reset_waits_until_the_service_would_succeed(referred: bool) -> None:
    controller = controller_of(rehearsal__reset_fault=0.05, activation__distance=0.5, plausibility__velocity=0.0)
    faults = []
    for k in range(200):
        controller.position[:] = (0.0 if k >= 120 else 1.0), 0.0
        stamp = START + k * MS + (30 * MS if k >= 10 else 0) + (30 * MS if k >= 150 else 0)
        controller.step(stamp, stamp if referred else -1)
        faults.append(controller.fault)
    # Without a reference, the arm cannot be too far from it. The second fault stays.
    end = 120 if referred else 20
    assert [k for k, fault in enumerate(faults) if fault] == [*range(10, end), *range(150, 200)]


def test_counters_survive_a_restart_of_the_source() -> None:
    controller = controller_of()
    for stamp in (START, START + 5 * MS):
        controller.step(stamp, -1)
    controller.set_clock(START - 10 * SECOND, 0)
    controller.step(START - 10 * SECOND, -1)
    assert controller.clock(Clock.LATE) == 1
    assert controller.commanded


@pytest.mark.parametrize("arrays", [True, False])
def test_results_are_written_to_the_given_arrays(arrays: bool) -> None:
    wanted: dict[str, Any] = {"effort": np.zeros(2), "signals": np.zeros((13, 2))} if arrays else {}
    controller = Controller(resolve(controller_schema, {}, 2), **wanted)
    status = controller.step(START, -1)
    assert status == controller.status
    assert len(status) == len(Status)
    np.testing.assert_array_equal(controller.effort, controller.state.signals[11])
    np.testing.assert_array_equal(controller.signals, controller.state.signals)
    for name, array in wanted.items():
        assert getattr(controller, name) is array
