"""The controller as an object: stamps, state, parameters, and when it must not move the arm."""

from typing import Any

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, Count, Time, controller_schema
from pidtsm_core.control.state import arrays_of
from pidtsm_core.laws import LAWS
from pidtsm_core.signals import Fault, Mode, Signal, Status

MS = 1_000_000
SECOND = 1000 * MS
START = 5 * SECOND
RECEIVED = ("measured", "applied", "received", "reference", "feedforward", "given")
"""Arrays that are written before a step."""
EACH = pytest.mark.parametrize("law", LAWS.names)


def everything(arm: Arm, law: str) -> dict[str, Any]:
    """Parameters with which much happens to the arm."""
    return {
        "law.name": law,
        "limits.effort_rate": (3.0 * arm.limits).tolist(),
        "limits.tracking_error": 0.05,
        "activation.blend": 0.02,
        "rehearsal.reset_fault": 0.08,
        "rehearsal.restart": 0.12,
    }


def controller_with(arm: Arm, settings: dict[str, Any]) -> Controller:
    return Controller(arm.values(controller_schema, settings))


def drive(controller: Controller, arm: Arm, samples: range = range(200)) -> Array:
    """Drive an arm that moves away and back, with one gap in its joint states and one in its references.

    Returns:
        Signals and status of each sample, shape (samples, len(Signal) + len(Status), joints).
    """
    rows = []
    size = np.array(arm.spread(0.3, -0.1))
    for k in samples:
        controller.position[:] = arm.start - size * np.sin(0.1 * k + 0.5 * np.arange(arm.joints))
        controller.given[0], controller.given[3] = arm.start, 0.05 * arm.limits
        stamp = START + k * MS + (30 * MS if k >= 150 else 0)
        controller.step(stamp, -1 if 20 <= k < 30 else stamp)
        rows.append(np.vstack([controller.signals, np.transpose([controller.status] * arm.joints)]))
    return np.array(rows)


@EACH
def test_a_run_after_reset_is_bit_for_bit_the_first(arm: Arm, law: str) -> None:
    controller = controller_with(arm, everything(arm, law))
    first = drive(controller, arm)
    assert controller.fault
    controller.reset()
    received = [getattr(controller.state, name) for name in RECEIVED]
    reset = [array for array in arrays_of(controller.state) if not any(array is each for each in received)]
    assert not any(array.any() for array in reset)
    np.testing.assert_array_equal(drive(controller, arm), first)
    np.testing.assert_array_equal(drive(controller_with(arm, everything(arm, law)), arm), first)


@EACH
def test_new_parameters_keep_the_state(arm: Arm, law: str) -> None:
    settings = everything(arm, law)
    controller = controller_with(arm, settings)
    expected = drive(controller_with(arm, settings), arm)
    drive(controller, arm, range(100))
    kept = [array.copy() for array in arrays_of(controller.state)]
    controller.set_parameters(arm.values(controller_schema, {"law.name": law, "limits.effort": 1e-3}))
    for before, now in zip(kept, arrays_of(controller.state), strict=True):
        np.testing.assert_array_equal(now, before)
    controller.set_parameters(arm.values(controller_schema, settings))
    np.testing.assert_array_equal(drive(controller, arm, range(100, 200)), expected[100:])


def test_compiling_leaves_the_initial_state(arm: Arm) -> None:
    controller = arm.controller()
    controller.compile()
    np.testing.assert_array_equal(drive(controller, arm), drive(arm.controller(), arm))


@pytest.mark.parametrize("later", [-3600 * SECOND, 5 * SECOND])
@pytest.mark.parametrize("moved", [False, True])
def test_after_a_clock_change_only_an_arm_that_has_moved_starts_afresh(loop_of: Any, later: int, moved: bool) -> None:
    loop = loop_of(2000)
    controller = loop.controller
    answered, before = controller.state.counts[Count.ANSWERED], controller.effort.copy()
    controller.position[:] = loop.robot.state.arm.position + (1.0 if moved else 0.0)
    stamp = controller.state.times[Time.LAST] + later
    controller.set_clock(stamp, MS)
    controller.step(stamp, -1)
    assert controller.fault == Fault.NO_FAULT
    assert controller.status[Status.MODE] == Mode.HOLDING
    assert controller.state.counts[Count.ANSWERED] == (1 if moved else answered + 1)
    assert moved or (np.abs(controller.effort - before) < 0.1 * loop.arm.limits).all()


@pytest.mark.parametrize(
    ("first", "last", "far"),
    [(0.0, 0.0, False), (0.49, -0.4, False), (0.0, 0.6, True), (-1.1, 0.6, True)],
)
def test_an_arm_far_from_its_reference_must_not_be_moved(arm: Arm, first: float, last: float, far: bool) -> None:
    controller = arm.controller(activation__distance=0.5)
    controller.position[:] = controller.reference[0] = arm.start
    controller.position[-1] += last
    controller.position[0] = arm.start[0] + (first or last if arm.joints == 1 else first)
    distances = np.abs(controller.position - arm.start)
    name, distance = arm.names[int(distances.argmax())], distances.max()
    unit = arm.robot.units[arm.names.index(name)].position
    reason = f"{name} is {distance:.3g} {unit} from its reference (activation.distance 0.5)"
    assert controller.refusal(True) == (reason if far else "")
    assert controller.refusal(False) == ""


@pytest.mark.parametrize("referred", [True, False])
def test_a_rehearsed_reset_waits_until_the_service_would_succeed(arm: Arm, referred: bool) -> None:
    controller = arm.controller(rehearsal__reset_fault=0.05, activation__distance=0.5, plausibility__velocity=0.0)
    faults = []
    for k in range(200):
        controller.position[0] = 0.0 if k >= 120 else 1.0
        stamp = START + k * MS + (30 * MS if k >= 10 else 0) + (30 * MS if k >= 150 else 0)
        controller.step(stamp, stamp if referred else -1)
        faults.append(controller.fault)
    # Without a reference, the arm cannot be too far from it. The second fault stays.
    end = 120 if referred else 20
    assert [k for k, fault in enumerate(faults) if fault] == [*range(10, end), *range(150, 200)]


def test_counters_survive_a_restart_of_the_source(arm: Arm) -> None:
    controller = arm.controller()
    for stamp in (START, START + 5 * MS):
        controller.step(stamp, -1)
    controller.set_clock(START - 10 * SECOND, 0)
    controller.step(START - 10 * SECOND, -1)
    assert controller.state.counts[Count.LATE] == 1
    assert controller.commanded


@pytest.mark.parametrize("arrays", [True, False])
def test_results_are_written_to_the_given_arrays(arm: Arm, arrays: bool) -> None:
    n = arm.joints
    wanted: dict[str, Any] = {"effort": np.zeros(n), "signals": np.zeros((len(Signal), n))} if arrays else {}
    controller = Controller(arm.values(controller_schema, {}), **wanted)
    status = controller.step(START, -1)
    assert status == controller.status
    assert len(status) == len(Status)
    np.testing.assert_array_equal(controller.effort, controller.state.signals[Signal.EFFORT])
    np.testing.assert_array_equal(controller.signals, controller.state.signals)
    for name, array in wanted.items():
        assert getattr(controller, name) is array


def test_the_longest_times_never_pass_and_their_sums_are_integers_too(arm: Arm) -> None:
    times = [f"watchdog.{name}" for name in ("state_hold", "state_stop", "reference")]
    times += [f"rehearsal.{name}" for name in ("reset_fault", "restart")]
    controller = controller_with(arm, dict.fromkeys(times, 2.0**62))
    config = controller.config
    longest = (
        config.watchdog.state_hold,
        config.watchdog.state_stop,
        config.watchdog.reference,
        config.rehearsal.reset_fault,
        config.rehearsal.restart,
    )
    assert 2 * int(max(longest)) <= np.iinfo(np.int64).max
    for k in range(3):
        controller.step(START + k * 1_000_000 * SECOND, START)
    assert controller.status[:2] == (Mode.FOLLOWING, Fault.NO_FAULT)
    assert controller.state.counts[Count.LATE] == 0
