"""Properties of every step: a sound torque and a consistent status."""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from support.pairs import paired
from support.testarms import ARMS, Arm

from pidtsm_core.control import Condition, Controller, Time, controller_schema
from pidtsm_core.laws import LAWS
from pidtsm_core.signals import Fault, Mode, Signal, Status, Stop, Violation

OF_A_JOINT = (Fault.POSITION_LIMIT, Fault.VELOCITY_LIMIT, Fault.TRACKING_LIMIT, Fault.MEASUREMENT, Fault.NO_EFFECT)
MS = 1_000_000
START = 1_000_000_000
NEAR, ANY = st.floats(-0.5, 0.5), st.floats(-1e6, 1e6)
ACTIONS = st.lists(
    st.tuples(
        st.sampled_from(["step", "step", "step", "step", "stop", "reset", "afresh"]),
        st.sampled_from([1, MS, MS, MS, 5 * MS, 30 * MS]),  # ns since the last
        st.one_of(NEAR, NEAR, ANY),  # measured
        st.one_of(NEAR, NEAR, ANY),  # desired
        st.sampled_from([0, 0, 0, 60 * MS, 200 * MS, -200 * MS]),  # age of the reference, ns
    ),
    min_size=1,
    max_size=60,
)
LIMITED: dict[str, Any] = {"limits.tracking_error": 5.0, "limits.velocity": 100.0}
WARNED: dict[str, Any] = {
    "limits.min_position": -0.1,
    "limits.max_position": 0.1,
    **{f"limits.{name}": 0.1 for name in ("velocity", "tracking_error")},
    **{f"limits.{name}_action": "warn" for name in ("position", "velocity", "tracking_error")},
}


def rate_of_first(arm: Arm) -> list[float]:
    """A limit of the rate for the first joint only."""
    return [2.0 * arm.limits[0], *[0.0] * (arm.joints - 1)]


CHANGES: dict[str, Callable[[Arm], dict[str, Any]]] = {
    "default": lambda arm: {},
    "limited": lambda arm: {**LIMITED, "limits.effort_rate": rate_of_first(arm)},
    "damped": lambda arm: {
        **LIMITED,
        "limits.effort_rate": rate_of_first(arm),
        "stop.effort": "gravity_damping",
        "plausibility.velocity": 0.0,
    },
    "warned": lambda arm: WARNED,
}


@paired("changes,law,arm", [c for c in CHANGES for _ in LAWS.names], LAWS.names, ARMS)
@hypothesis_settings(max_examples=10)
@given(actions=ACTIONS)
def test_the_torque_is_always_sound_and_the_status_consistent(
    arm: Arm, law: str, changes: str, actions: list[tuple[str, int, float, float, int]]
) -> None:
    controller = Controller(arm.values(controller_schema, {"law.name": law, **CHANGES[changes](arm)}))
    shares = np.array(arm.spread(1.0, -0.5))
    config, stamp, fault = controller.config, START, Fault.NO_FAULT
    for action, elapsed, measured, desired, age in actions:
        before = controller.effort.copy()
        if action == "reset":
            controller.reset_fault()
            fault = Fault.NO_FAULT
            continue
        if action == "afresh":
            stamp -= 10 * START
            controller.set_clock(stamp + elapsed, 0)
        stamp += elapsed
        begun, sent = controller.commanded, controller.state.times[Time.SENT]
        if action == "stop":
            controller.stop(Fault.STATE_STALE, stamp - controller.state.times[Time.LAST])
        else:
            controller.position[:], controller.reference[0] = measured * shares, desired
            controller.step(stamp, stamp - age)

        assert np.isfinite(controller.signals).all()
        assert (np.abs(controller.effort) <= config.limits.effort).all()
        np.testing.assert_array_equal(controller.signals[Signal.EFFORT], controller.effort)
        mode, now, joint, violations, stage = controller.status
        assert (mode == Mode.STOPPED) == (now != Fault.NO_FAULT)
        assert not fault or now == fault, "latched"
        assert 0 <= joint <= arm.joints
        assert (joint > 0) == (now in OF_A_JOINT)
        assert not violations & ~sum(Violation)
        assert Stop(stage) == Stop.NONE or now
        fault = Fault(now)
        if begun and action == "step" and not controller.state.conditions[Condition.UNLIMITED]:
            allowed = config.limits.effort_rate * (stamp - sent if action != "afresh" else 0) * 1e-9
            assert (np.abs(controller.effort - before) <= allowed + 1e-9)[config.limits.effort_rate > 0.0].all()


def test_a_removed_limit_is_no_longer_exceeded(arm: Arm) -> None:
    controller = arm.controller(limits__min_position=-0.5, limits__max_position=0.5, limits__position_action="warn")
    controller.position[:] = 0.6
    controller.step(0, -1)
    assert controller.status[Status.VIOLATIONS] == Violation.POSITION
    controller.set_parameters(arm.values(controller_schema, {}))
    controller.step(1_000_000, -1)
    assert controller.status[Status.VIOLATIONS] == 0
