"""In freedrive a push moves the arm, nothing else does, and what follows begins without a step."""

from typing import Any

import numpy as np
import pytest
from testarms import ARMS, PANDA, TWO_LINK, Arm, dotted

from pidtsm_core.closed_loop import rollout
from pidtsm_core.control import Clock, Controller
from pidtsm_core.parameters import Array
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.signals import Fault, Mode, Request, Signal, Status

MS = 1_000_000
START = 1_000_000_000
FREE, PUSHED, RELEASED, HELD, FOLLOWED = 1.5, 1.8, 2.4, 4.5, 4.7
"""s; when freedrive begins, a push begins and ends, and ``~/hold`` is called with true and with false."""
VELOCITY = 0.5  # rad/s
SENSORS = {"encoder.bits": 14, "delay.samples": 1}
IMPERFECTIONS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "sensors": SENSORS,
    "payload": {**SENSORS, "payload.time": 0.0},
    "model": {**SENSORS, "model_error.mass": 0.1, "model_error.inertia": 0.3},
    "no friction": {**SENSORS, "friction.coulomb": 0.0},
}
"""Of the simulated arms; that without friction has less than the controller compensates."""
PUSHES = {TWO_LINK: [25.0, -10.0], PANDA: [8.0, 0.0, 8.0, -8.0, 0.0, 2.0, 0.0]}
RESISTANCE, PAYLOAD = {TWO_LINK: 0.1, PANDA: 0.05}, {TWO_LINK: 0.3, PANDA: 1.2}
"""Share of the effort limits, and kg that the controller does not know."""


def at(run: Recording, begin: float, end: float) -> slice:
    return slice(*np.searchsorted(run.time, [begin, end]))


def freed(arm: Arm, imperfection: str, push: float = 1.0, hold: float = HELD, **controller: object) -> Recording:
    """A rollout with freedrive, in which something pushes the joints."""
    settings = {
        "freedrive.velocity": VELOCITY,
        "freedrive.resistance": RESISTANCE[arm],
        "rehearsal.hold": hold,
        "rehearsal.freedrive": FREE,
        "rehearsal.follow": FOLLOWED,
        "compensation.coulomb": (0.01 * arm.limits).tolist() if imperfection == "no friction" else 0.0,
        **dotted(controller),
    }
    simulator = {
        "disturbance.name": "none",
        "push.effort": (push * np.array(PUSHES[arm])).tolist(),
        "push.time": PUSHED,
        "push.duration": RELEASED - PUSHED,
        "payload.mass": PAYLOAD[arm] if imperfection == "payload" else 0.0,
        **IMPERFECTIONS[imperfection],
    }
    nodes = {"controller": settings, "simulator": simulator}
    return rollout(None, "piddtsm", "practical", arm.description, duration=HELD + 1.5, **nodes)


def kinetic(arm: Arm, run: Recording, samples: slice) -> Array:
    """Kinetic energy at the samples, by the model, J."""
    states = zip(run.position[samples], run.velocity[samples], strict=True)
    return np.array([0.5 * v @ (arm.effort(q, ddq=v) - arm.effort(q)) for q, v in states])


EACH_ARM = pytest.mark.parametrize("arm", PUSHES, ids=str)


@EACH_ARM
@pytest.mark.parametrize("imperfection", IMPERFECTIONS)
def test_a_push_moves_the_arm_and_nothing_else_does(arm: Arm, imperfection: str) -> None:
    run = freed(arm, imperfection)
    modes = run.status[:, Status.MODE]
    assert (modes[at(run, FREE, HELD)] == Mode.FREEDRIVE).all()
    assert not run.status[:, Status.FAULT].any()
    pushed, after = at(run, PUSHED, RELEASED), at(run, RELEASED + 0.1, HELD)
    assert np.abs(run.position[pushed] - run.position[pushed.start]).max() > 0.05
    assert np.abs(run.velocity[pushed]).max() < 1.6 * VELOCITY
    assert np.abs(run.velocity[pushed][-100:]).max() < 1.1 * VELOCITY
    energy = kinetic(arm, run, after)
    assert (energy - np.minimum.accumulate(energy)).max() < 5e-3
    last = at(run, HELD - 0.3, HELD)
    assert np.abs(run.position[last] - run.position[last.start]).max() < 2e-3


@EACH_ARM
@pytest.mark.parametrize("imperfection", ["ideal", "payload"])
def test_it_ends_without_a_step_and_the_arm_returns_slowly_when_it_may(arm: Arm, imperfection: str) -> None:
    """It ends while the arm is pushed."""
    run = freed(arm, imperfection, hold=RELEASED - 0.2)
    efforts = run.signals[:, Signal.EFFORT]
    ends = at(run, RELEASED - 0.2 - 2e-3, RELEASED - 0.2 + 4e-3)
    assert np.abs(np.diff(efforts[ends], axis=0)).max() < 1.0
    held, following = at(run, FOLLOWED - 0.5, FOLLOWED), at(run, FOLLOWED, HELD + 1.5)
    assert (run.status[held, Status.MODE] == Mode.HOLDING).all()
    assert np.abs(run.position[held] - run.position[held.start]).max() < 0.02
    assert (run.status[following, Status.MODE] == Mode.FOLLOWING).all()
    reference = np.abs(run.reference[following, 1]).max()
    assert np.abs(run.velocity[following]).max() < 1.2 * VELOCITY + reference


@EACH_ARM
@pytest.mark.parametrize("imperfection", ["ideal", "payload"])
def test_an_arm_at_rest_stays_at_rest(arm: Arm, imperfection: str) -> None:
    run = freed(arm, imperfection, push=0.0, hold=FREE - 0.4)
    free = at(run, FREE, HELD)
    assert (run.status[free, Status.MODE] == Mode.FREEDRIVE).all()
    assert np.abs(run.position[free] - run.position[free.start]).max() < 1e-2


def test_a_push_is_no_collision() -> None:
    run = freed(PANDA, "ideal", limits__external_effort=1.0, limits__external_effort_action="stop")
    assert not run.status[at(run, 0.0, HELD), Status.FAULT].any()


def test_position_limits_are_soft_walls() -> None:
    limits = np.array(find_robot(PANDA.settings).position_limits)
    run = rollout(
        None,
        "piddtsm",
        "practical",
        "panda",
        duration=3.0,
        controller={"rehearsal.freedrive": 0.1},
        simulator={**SENSORS, "push.effort": [0, 0, 0, -12.0, 0, 0, 0], "push.time": 0.2, "push.duration": 9.0},
    )
    assert not run.status[:, Status.FAULT].any()
    assert run.position[-1, 3] - limits[3, 0] < 0.15
    assert (run.position[:, 3] > limits[3, 0]).all()


class Still:
    """A controller of an arm that does not move."""

    def __init__(self, arm: Arm, **changes: object) -> None:
        self.controller: Controller = arm.controller(**changes)
        self.controller.position[:] = self.controller.reference[0] = arm.start
        self.sample = 0

    def step(self, samples: int, off: float = 0.0) -> int:
        """Answer so many joint states, from an arm that is off by `off`, rad; return the mode."""
        for _ in range(samples):
            self.sample += 1
            self.controller.position[0] += off / samples
            self.controller.step(START + self.sample * MS, START + self.sample * MS)
        return self.controller.status[Status.MODE]


def test_requests_choose_the_mode_and_nothing_is_learnt_in_freedrive(arm: Arm) -> None:
    still = Still(arm)
    controller = still.controller
    assert still.step(2000, 1e-3) == Mode.FOLLOWING
    assert controller.request(Request.FREE) == ""
    assert still.step(1) == Mode.FREEDRIVE
    learnt = controller.state.law.copy()
    assert still.step(100, 0.01) == Mode.FREEDRIVE
    np.testing.assert_array_equal(controller.state.law, learnt)
    modes = {Request.HOLD: Mode.HOLDING, Request.FOLLOW: Mode.FOLLOWING, Request.FREE: Mode.FREEDRIVE}
    for request, mode in modes.items():
        assert controller.request(request) == ""
        assert still.step(1) == mode
    assert controller.request(Request.FOLLOW) == ""
    assert still.step(1) == Mode.FOLLOWING


def test_requests_are_rehearsed_once_at_their_times(arm: Arm) -> None:
    still = Still(arm, rehearsal__freedrive=0.05, rehearsal__hold=0.1, rehearsal__follow=0.15)
    modes = [still.step(1) for _ in range(200)]
    expected = [(50, Mode.FOLLOWING), (50, Mode.FREEDRIVE), (50, Mode.HOLDING), (50, Mode.FOLLOWING)]
    assert modes == [mode for samples, mode in expected for _ in range(samples)]


def test_a_fault_ends_freedrive_and_the_arm_is_held_afterwards(arm: Arm) -> None:
    still = Still(arm)
    controller = still.controller
    still.step(10)
    controller.request(Request.FREE)
    still.step(10)
    still.sample += 100
    assert still.step(1) == Mode.STOPPED
    assert controller.fault == Fault.STATE_STALE
    for request in (Request.FREE, Request.FOLLOW):
        assert controller.request(request) == "there is a fault; call ~/reset_fault"
    controller.reset_fault()
    assert still.step(5) == Mode.HOLDING
    assert controller.clock(Clock.REQUEST) == Request.HOLD


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_a_law_without_a_model_refuses_freedrive_but_holds(arm: Arm) -> None:
    still = Still(arm, law__name="pid")
    still.step(10)
    assert "no model" in still.controller.request(Request.FREE)
    assert still.step(1) == Mode.FOLLOWING
    assert still.controller.request(Request.HOLD) == ""
    assert still.step(1) == Mode.HOLDING
