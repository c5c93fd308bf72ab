"""A controller that no other can beat by much: it acts on the true state of the simulated robot, with its true model.

It knows what no controller knows: positions and velocities of links and motors without noise, steps, delay or loss; the
masses, payload, stiffness and friction of the simulated arm, and the whole motion in advance. Its torque has the same
limits. Along the motion it commands what the motion needs (M. W. Spong, J. Dyn. Sys. Meas. Control 109, 1987, with the
lag of the drives); a linear-quadratic regulator of the sampled arm brings it back (B. D. O. Anderson and J. B. Moore,
Optimal Control, 1990, section 2.4).
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_discrete_are

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import lend
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.events import first_compilation
from pidtsm_core.experiment import Experiment
from pidtsm_core.experiment.loop_margin import Drives, sampled_plant
from pidtsm_core.parameters import Value, as_float, joint_array, names
from pidtsm_core.parameters.joints import JointOrder
from pidtsm_core.recording import Recording
from pidtsm_core.references import MotionConfig, ReferenceMotion, evaluate_motion
from pidtsm_core.robots import Model, find_robot, inverse_dynamics, robot_parameters
from pidtsm_core.rollouts.closed_loop import DivergedError
from pidtsm_core.signals import Signal, Status
from pidtsm_core.simulation.simulator import SimulatedRobot, act, sense
from pidtsm_core.simulation.simulator_state import SimulatorConfig, SimulatorState
from pidtsm_core.timing import period_nanoseconds, seconds

ERRORS = (1e-3, 1e-2, 1e-1)
"""Errors (rad or m) that the regulator opposes with the whole torque of a joint: it may be fast or smooth."""
_REVERSAL = 1e-3
"""rad/s; below this desired velocity, the compensated friction goes to zero."""


class Plan(NamedTuple):
    """What the oracle has computed before the run, by sample.

    Attributes:
        state: desired positions of links and elastic motors, their velocities, and with a lag the torques of the
            drives, shape (samples, states).
        torque: that the motion needs, shape (samples, joints), N m.
        gain: of the regulator, shape (joints, states).
        elastic: joints whose motors have states of their own.
        kept: share of a torque that the lag leaves after a sample; 0: no lag.
    """

    state: Array
    torque: Array
    gain: Array
    elastic: Any
    kept: float


class _Run(NamedTuple):
    position: Array  # shape (samples, joints), as the next three
    velocity: Array
    effort: Array
    command: Array
    torque: Array  # scratch: the command, shape (joints,)
    lagging: Array  # torque of the drives as the oracle knows it, shape (joints,)
    state: Array  # scratch, shape (states,)


def oracle(scenario: Experiment, *, error: float = ERRORS[0], duration: float | None = None) -> Recording:
    """Simulate the robot of an experiment with the oracle instead of its controller.

    Args:
        scenario: the experiment; of its controller nothing matters.
        error: see `ERRORS`.
        duration: s; None: that of the experiment.

    Raises:
        UsageError: see `rollout`.
        DivergedError: a value is no longer finite.
    """
    experiment, values = scenario, scenario.values
    simulator, joints = values["simulator"], names(values["simulator"]["joints"])
    places = np.array(JointOrder(joints).match(names(values["trajectory"]["joints"])))
    robot, motion = SimulatedRobot(simulator, accelerations=False), ReferenceMotion(values["trajectory"])
    period = period_nanoseconds(int(as_float(simulator["rate"])))
    count = round((duration or experiment.duration) * 1e9 / period)
    reference = np.empty((count + 1, 3, len(joints)))
    with first_compilation():
        _evaluate(motion.config, seconds(period), reference)
        reference = np.ascontiguousarray(reference[:, :, places])
        plan = _plan(simulator, robot.config, reference, seconds(period), error)
        position, velocity, effort, command = (np.empty((count, len(joints))) for _ in range(4))
        torque, lagging, state = plan.torque[0].copy(), plan.torque[0].copy(), np.zeros(plan.state.shape[1])
        run = _Run(position, velocity, effort, command, torque, lagging, state)
        done = _simulate(robot.config, robot.state, robot.randomness.draw(count), plan, period, run)
    if done < count:
        raise DivergedError(f"the oracle's loop is not finite any more after {seconds(done * period):g} s")
    return _recording(experiment, values, reference[:count], run, period)


def _recording(
    experiment: Experiment, values: Mapping[str, Mapping[str, Value]], reference: Array, run: _Run, period: int
) -> Recording:
    count, joints = run.position.shape
    signals = np.zeros((count, len(Signal), joints))
    signals[:, Signal.EFFORT] = run.command
    arm = find_robot(values["simulator"])
    stamps = np.arange(count) * period
    return Recording(
        joints=names(values["simulator"]["joints"]),
        time=np.asarray(stamps * 1e-9, dtype=np.float64),
        position=run.position,
        velocity=run.velocity,
        effort=run.effort,
        reference=reference,
        signals=signals,
        status=np.zeros((count, len(Status)), dtype=np.uint8),
        stamps_ns=stamps,
        compute_time=np.empty(0),
        scenario=experiment.scenario,
        law="oracle",
        clock=None,
        event_time=experiment.event_time,
        slides=arm.slides,
        continuous=arm.continuous,
        robot=robot_parameters(values["simulator"]),
    )


def _plan(values: Mapping[str, Value], config: SimulatorConfig, reference: Array, period: float, error: float) -> Plan:
    """What the motion needs, and the regulator about its middle."""
    joints, plant = reference.shape[2], config.plant
    gears = plant.drivetrain
    stiffness = gears.stiffness if gears.substeps > 0 else np.zeros(joints)
    elastic = np.flatnonzero(stiffness)
    lag = float(joint_array(values["actuator.lag"], joints).max())
    frequency, damping = (joint_array(values[f"actuator.{name}"], joints) for name in ("frequency", "damping"))
    # A second-order loop counts as its delay.
    lag += float(np.divide(2.0 * damping, frequency, out=np.zeros(joints), where=frequency > 0.0).max())
    rotor = np.where(stiffness > 0.0, gears.rotor, 0.0)
    link = np.empty((reference.shape[0], joints))
    time: Array = np.asarray(np.arange(reference.shape[0]) * period, dtype=np.float64)
    carries = (time >= plant.payload_begin) & (time < plant.payload_end)
    _needed(plant.model, plant.loaded_model, carries, reference, link)
    link -= rotor * reference[:, 2]
    twist = np.divide(link, stiffness, out=np.zeros_like(link), where=stiffness > 0.0)
    twisted, accelerated = (_derived(twist, period, order) for order in (1, 2))
    speed: Array = np.asarray(reference[:, 1] + twisted, dtype=np.float64)
    torque = link + rotor * (reference[:, 2] + accelerated) + _friction(values, joints, speed, link, time)
    states = [reference[:, 0], (reference[:, 0] + twist)[:, elastic], reference[:, 1], speed[:, elastic]]
    needed = torque
    if lag > 0.0:
        states.append(torque)
        needed = torque + lag * _derived(torque, period, 1)
    pushed = (time >= plant.push_begin) & (time < plant.push_end)
    needed = needed - np.where(pushed[:, np.newaxis], plant.push, 0.0)
    drives = Drives(period, 0, lag, rotor, stiffness, gears.damping if elastic.size else np.zeros(joints), False)
    middle = 0.5 * (reference[:, 0].min(axis=0) + reference[:, 0].max(axis=0))
    inertia = _inertia(plant.loaded_model if carries.any() else plant.model, middle)
    limits = plant.effort_limit
    return Plan(
        state=np.ascontiguousarray(np.hstack(states)),
        # Of the middle of a sample, over which it is held.
        torque=np.clip(0.5 * (needed[:-1] + needed[1:]), -limits, limits),
        gain=_regulator(drives, inertia, limits, error),
        elastic=elastic.astype(np.int64),
        kept=float(np.exp(-period / lag)) if lag > 0.0 else 0.0,
    )


def _derived(values: Array, period: float, order: int) -> Array:
    """Derivative over time, by central differences: the motion is smooth but at the ends of its pieces."""
    for _ in range(order):
        values = np.gradient(values, period, axis=0)
    return values


def _friction(values: Mapping[str, Value], joints: int, speed: Array, link: Array, time: Array) -> Array:
    """Friction of joints with these velocities, shape (samples, joints), N m; see `gear_friction` and `friction`."""
    coulomb, static, viscous, offset, load, asymmetry, cold, warm_up = (
        joint_array(values[f"friction.{name}"], joints)
        for name in ("coulomb", "static", "viscous", "offset", "load", "asymmetry", "cold", "warm_up")
    )
    stribeck = joint_array(values["friction.stribeck_velocity"], joints)
    level = coulomb + np.maximum(static - coulomb, 0.0) * np.exp(-((speed / stribeck) ** 2))
    level *= 1.0 + cold * np.exp(-time[:, np.newaxis] / warm_up)
    direction = np.tanh(speed / _REVERSAL)
    return (level + load * np.abs(link)) * (1.0 + asymmetry * direction) * direction + viscous * speed + offset


def _regulator(drives: Drives, inertia: Array, limits: Array, error: float) -> Array:
    """Gain of the linear-quadratic regulator, shape (joints, states)."""
    a, b, _ = sampled_plant(drives, inertia)
    joints = limits.size
    weights = np.zeros(a.shape[0])
    weights[:joints] = 1.0 / error**2
    cost, effort = np.diag(np.maximum(weights, 1e-9)), np.diag(1.0 / limits**2)
    try:
        value = solve_discrete_are(a, b, cost, effort)
    except LinAlgError as reason:
        raise DivergedError(f"there is no regulator: {reason}") from None
    return np.ascontiguousarray(np.linalg.solve(effort + b.T @ value @ b, b.T @ value @ a))


def _inertia(model: Model, q: Array) -> Array:
    """Inertia matrix of a model at q, shape (joints, joints), kg m^2."""
    rows = np.vstack([np.zeros(q.size), np.eye(q.size)])
    efforts = np.zeros_like(rows)
    inverse_dynamics(model, q, np.zeros(q.size), rows, efforts)
    inertia = efforts[1:] - efforts[0]
    return np.asarray(0.5 * (inertia + inertia.T))


@njit
def _evaluate(motion: MotionConfig, period: float, reference: Array) -> None:
    """Write the motion of every sample, shape (samples, 3, joints)."""
    for k in range(reference.shape[0]):
        evaluate_motion(motion, k * period, reference[k])


@njit
def _needed(empty: Model, loaded: Model, carries: NDArray[np.bool_], reference: Array, effort: Array) -> None:
    """Write the effort of the motion without friction, shape (samples, joints), N m."""
    for k in range(effort.shape[0]):
        desired = reference[k]
        inverse_dynamics(loaded if carries[k] else empty, desired[0], desired[1], desired[2:3], effort[k : k + 1])


@njit
def _simulate(values: SimulatorConfig, memory: SimulatorState, draws: Array, plan: Plan, period: int, run: _Run) -> int:
    """Run the loop; return the number of samples with finite values."""
    hardware, robot = lend(values), lend(memory)
    arm, dt, elastic = robot.arm, seconds(period), plan.elastic
    joints, own = run.position.shape[1], elastic.size
    limit = hardware.plant.effort_limit
    torque, lagging, x = run.torque, run.lagging, run.state
    for k in range(run.position.shape[0]):
        sense(hardware, robot, draws[k], k)
        for j in range(joints):
            x[j] = arm.position[j]
            x[joints + own + j] = arm.derivatives[0, j]
        for i in range(own):
            x[joints + i] = arm.drivetrain.motor[elastic[i]]
            x[2 * joints + own + i] = arm.drivetrain.motor_velocity[elastic[i]]
        if plan.kept > 0.0:
            for j in range(joints):
                x[2 * (joints + own) + j] = lagging[j]
        for j in range(joints):
            command = plan.torque[k, j]
            for i in range(x.size):
                command -= plan.gain[j, i] * (x[i] - plan.state[k, i])
            torque[j] = min(max(command, -limit[j]), limit[j])
            lagging[j] = torque[j] + plan.kept * (lagging[j] - torque[j])
            run.position[k, j] = arm.position[j]
            run.velocity[k, j] = arm.derivatives[0, j]
            run.command[k, j] = torque[j]
        for j in range(joints):
            if not math.isfinite(arm.position[j] + torque[j]):
                return k
        act(hardware, robot, draws[k], k, True, torque, seconds(k * period), dt)
        for j in range(joints):
            run.effort[k, j] = arm.effort[j]
    return run.position.shape[0]
