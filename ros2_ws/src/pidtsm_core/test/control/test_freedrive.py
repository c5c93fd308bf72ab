"""In freedrive a push moves the arm, nothing else does, and what follows begins without a step."""

from typing import Any

import numpy as np
import pytest
from support.testarms import ARMS, PANDA, TWO_LINK, Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.control import Condition, Controller, Time
from pidtsm_core.control.freedrive import refusal
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
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
    assert controller.state.conditions[Condition.REQUEST] == Request.HOLD


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_a_law_without_a_model_refuses_freedrive_but_holds(arm: Arm) -> None:
    still = Still(arm, law__name="pid")
    still.step(10)
    assert "no model" in still.controller.request(Request.FREE)
    assert still.step(1) == Mode.FOLLOWING
    assert still.controller.request(Request.HOLD) == ""
    assert still.step(1) == Mode.HOLDING


def light_arm(rotor: float) -> Arm:
    """An arm whose last joint moves a ten thousandth of what the first one moves, as URDFs without rotors have it."""
    masses, inertias = (8.0, 4.0, 0.3, 0.1), (0.3, 0.1, 3e-4, 5e-5)
    links = "".join(
        f'<link name="l{j}"><inertial><origin xyz="{0.4 * m / 8.0} 0 0.01"/><mass value="{m}"/>'
        f'<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for j, (m, i) in enumerate(zip(masses, inertias, strict=True))
    )
    axes, efforts = ("0 1 0", "0 1 0", "0 1 0", "1 0 0"), (300.0, 150.0, 54.0, 54.0)
    joints = "".join(
        f'<joint name="j{j}" type="revolute"><parent link="{"base" if j == 0 else f"l{j - 1}"}"/><child link="l{j}"/>'
        f'<origin xyz="{0.4 * (j in (1, 2))} 0 0.05"/><axis xyz="{axis}"/>'
        f'<limit lower="-3" upper="3" effort="{effort}" velocity="2"/></joint>'
        for j, (axis, effort) in enumerate(zip(axes, efforts, strict=True))
    )
    return Arm(f'<robot name="light{rotor}"><link name="base"/>{links}{joints}</robot>', (0.1, 0.3, -0.2, 0.1))


LIGHT = {rotor: light_arm(rotor) for rotor in (0.0, 0.02)}
HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "14 bit, late": SENSORS,
    "12 bit": {"encoder.bits": 12},
    "noise": {"noise.std": 1e-4},
    "lag": {"encoder.bits": 14, "delay.samples": 1, "actuator.lag": 0.005},
    "250 Hz": {"rate": 250, **SENSORS},
    "2 kHz": {"rate": 2000, "encoder.bits": 14},
}


def freed_light(rotor: float, hardware: str, push: float = 0.0) -> Recording:
    """A rollout of `light_arm` with freedrive, with a push that accelerates every joint with `push` (rad/s^2)."""
    arm = LIGHT[rotor]
    acceleration = arm.alternating(push)
    effort = arm.effort(arm.start, ddq=acceleration) - arm.effort(arm.start) + rotor * acceleration
    simulator = {
        "robot.armature": rotor,
        "push.effort": effort.tolist(),
        "push.time": PUSHED,
        "push.duration": RELEASED - PUSHED,
        **HARDWARE[hardware],
    }
    controller = {"rehearsal.freedrive": FREE, "robot.armature": rotor}
    return rollout(None, None, "practical", arm.description, duration=HELD, controller=controller, simulator=simulator)


@pytest.mark.parametrize("rotor", LIGHT)
@pytest.mark.parametrize("hardware", HARDWARE)
def test_light_joints_do_not_run_away(rotor: float, hardware: str) -> None:
    """Joints that the resistance would accelerate with 10,000 rad/s^2; nobody touches the arm, which moved before."""
    run = freed_light(rotor, hardware)
    free, last = at(run, FREE, HELD), at(run, HELD - 1.0, HELD)
    assert (run.status[free, Status.MODE] == Mode.FREEDRIVE).all()
    assert np.abs(run.velocity[free]).max() < 0.5 * VELOCITY
    assert np.ptp(run.position[last], axis=0).max() < 1e-2


@pytest.mark.parametrize("rotor", LIGHT)
@pytest.mark.parametrize("hardware", ["ideal", "14 bit, late", "lag"])
def test_a_push_moves_light_joints_within_their_limits(rotor: float, hardware: str) -> None:
    run = freed_light(rotor, hardware, push=20.0)
    pushed, after, last = at(run, PUSHED, RELEASED), at(run, RELEASED + 0.1, HELD), at(run, HELD - 1.0, HELD)
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(run.position[pushed] - run.position[pushed.start]).max() > 0.05
    assert np.abs(run.velocity).max() < 2.0
    energy = np.array(
        [
            0.5 * v @ (LIGHT[rotor].effort(q, ddq=v) - LIGHT[rotor].effort(q) + rotor * v)
            for q, v in zip(run.position[after], run.velocity[after], strict=True)
        ]
    )
    assert (energy - np.minimum.accumulate(energy)).max() < 0.01  # J
    assert np.ptp(run.position[last], axis=0).max() < 5e-3


@pytest.mark.parametrize("hardware", HARDWARE)
def test_a_hard_push_is_braked_although_the_estimated_velocity_is_late(hardware: str) -> None:
    """It accelerates every joint with 0.38 times what the dampers take at the velocity limit."""
    rate = HARDWARE[hardware].get("rate", 1000)
    run = freed_light(0.02, hardware, push=0.38 * 2.4 * min(40.0, 0.08 * rate) * 2.0)
    pushed, last = at(run, PUSHED, RELEASED), at(run, HELD - 1.0, HELD)
    assert np.abs(run.position[pushed] - run.position[pushed.start]).max() > 0.05
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(run.velocity).max() < 2.0
    assert np.ptp(run.position[last], axis=0).max() < 1e-2


FORCES = {
    "scara": (10.0, 10.0, 40.0),
    "panda": (20.0, 30.0, -20.0),
    "ur5": (-40.0, 20.0, 20.0),
    "z1": (10.0, -14.0, 14.0),
}
"""Of a hand on the tool, N, in the axes of the base."""


@pytest.mark.parametrize("robot", FORCES)
@pytest.mark.parametrize("hardware", ["14 bit, late", "lag", "250 Hz"])
def test_a_hand_moves_the_arm_within_its_limits(robot: str, hardware: str) -> None:
    """For one second, which takes the scara to the end of its vertical axis."""
    simulator = {
        "disturbance.name": "none",
        "push.force": FORCES[robot],
        "push.time": 1.5,
        "push.duration": 1.0,
        **HARDWARE[hardware],
    }
    controller = {"rehearsal.freedrive": 1.0}
    run = rollout(None, None, "practical", robot, duration=4.0, controller=controller, simulator=simulator)
    pushed, last = at(run, 1.5, 2.5), at(run, 3.0, 4.0)
    assert np.abs(run.position[pushed] - run.position[pushed.start]).max() > 0.05
    assert not run.status[:, Status.FAULT].any()
    assert (np.abs(run.velocity).max(axis=0) < find_robot({"robot.description": robot}).velocity_limit).all()
    assert np.ptp(run.position[last], axis=0).max() < 1e-2


@pytest.mark.parametrize("robot", ["xarm7", "z1"])
def test_friction_that_is_not_there_does_not_drive_the_arm(robot: str) -> None:
    """The description has friction, which is compensated; the arm has none."""
    simulator = {**SENSORS, "friction.coulomb": 0.0, "friction.viscous": 0.0}
    run = rollout(
        None, None, "practical", robot, duration=4.0, controller={"rehearsal.freedrive": 1.0}, simulator=simulator
    )
    last = at(run, 3.0, 4.0)
    assert (run.status[last, Status.MODE] == Mode.FREEDRIVE).all()
    assert np.ptp(run.position[last], axis=0).max() < 1e-2


@EACH_ARM
def test_it_begins_without_a_step_of_the_torque(arm: Arm) -> None:
    """The arm moves when it begins; the torque that stops it grows over many commands."""
    run = freed(arm, "ideal", push=0.0)
    begins = at(run, FREE - 2e-3, FREE + 0.1)
    assert (np.abs(np.diff(run.effort[begins], axis=0)).max(axis=0) / arm.limits).max() < 0.08


def refused(arm: Arm, period: int = MS, **changes: object) -> str:
    controller = arm.controller(**changes)
    controller.position[:] = arm.start
    controller.state.times[Time.PERIOD] = period
    return refusal(controller.config, controller.state, arm.names)


def test_it_accepts_every_arm_at_its_rate(arm: Arm) -> None:
    assert refused(arm) == ""
    assert refused(arm, period=10 * MS) == ""


def test_it_refuses_an_arm_that_it_cannot_hold() -> None:
    light = LIGHT[0.0]
    assert refused(light) == ""
    assert "j3 is so light" in refused(light, period=20 * MS) or "j2 is so light" in refused(light, period=20 * MS)
    assert "robot.armature" in refused(light, period=20 * MS)
    assert refused(LIGHT[0.02], period=20 * MS, robot__armature=0.02) == ""
    assert "too light" in refused(light, freedrive__velocity=0.02)
    weak = light.limits * [0.05, 1.0, 1.0, 1.0]
    assert "j0 needs" in refused(light, limits__effort=weak.tolist())
