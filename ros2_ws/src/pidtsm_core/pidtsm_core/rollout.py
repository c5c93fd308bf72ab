"""The closed loop without ROS: the compiled functions of the nodes in one compiled loop."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiled import inlined, njit
from pidtsm_core.control import Controller, ControllerConfig, ControllerState, controller_schema, step
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.joints import JointOrder
from pidtsm_core.parameters import Array, ParameterError, Schema, Value, as_float, names, resolve
from pidtsm_core.references import (
    MotionConfig,
    ReferenceMotion,
    drops_out,
    evaluate_motion,
    reference_joints,
    reference_schema,
)
from pidtsm_core.robots import robot_joints, robot_parameters
from pidtsm_core.signals import Signal, Status
from pidtsm_core.simulation.simulator import (
    SimulatedRobot,
    SimulatorConfig,
    SimulatorState,
    act,
    sense,
    simulator_schema,
)
from pidtsm_core.timing import period_nanoseconds, seconds

SCHEMAS = {"controller": controller_schema, "simulator": simulator_schema, "trajectory": reference_schema}
"""Schemas of a rollout, by node: the parameters that affect a torque."""
_JOINTS = {"controller": robot_joints, "simulator": robot_joints, "trajectory": reference_joints}

EXPERIMENT: Mapping[str, Mapping[str, Value]] = {
    "simulator": {"command.timeout": 1.0},
    "controller": {"activation.blend": 0.0, "watchdog.state_stop": 1.0},
    "trajectory": {},
}
"""Defaults of an experiment (a run or a rollout) that differ from those of the nodes: an experiment measures the law
from its first sample on, and no watchdog should end it."""

Places = NDArray[np.int64]


@dataclass(frozen=True)
class Rollout:
    """Result of a closed loop; row k of every array belongs to time[k].

    Attributes:
        joints: names, in the order of the simulator.
        time: s, shape (samples,).
        position, velocity: true q (rad or m), q' (rad/s or m/s), shape (samples, joints).
        effort: effort applied from time[k] on, N m or N, shape (samples, joints).
        reference: q_d, q_d', q_d'', shape (samples, 3, joints).
        signals: signals that the controller computed from the measurement of this sample; if none reached it, the
            last ones, shape (samples, len(Signal), joints), order of `Signal`.
        status: status of the controller, likewise, shape (samples, len(Status)), order of `Status`.
        robot: parameters of the simulated arm, as returned by `robot_parameters`.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array
    status: NDArray[np.uint8]
    robot: Mapping[str, Value] = field(default_factory=dict)


class _Samples(NamedTuple):
    """The arrays of a `Rollout` while it is simulated.

    `signals` and the joint of `status` are in the order of the controller, `reference` is in that of the trajectory.
    """

    time: Array
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array
    status: NDArray[np.uint8]


class _Loop(NamedTuple):
    """Controller, robot and desired motion in the form that compiled code reads and changes."""

    controller: ControllerConfig
    state: ControllerState
    hardware: SimulatorConfig
    robot: SimulatorState
    motion: MotionConfig
    places: Places  # of the controller's joints among the simulator's and the trajectory's, shape (2, joints)
    period: int  # ns


@inlined
def _keep(samples: _Samples, start: int, stop: int, controller: ControllerState) -> None:
    """Fill the rows from `start` to before `stop` with the last result of the controller."""
    y, last = controller.signals, controller.status
    for k in range(start, stop):
        for i in range(y.shape[0]):
            for j in range(y.shape[1]):
                samples.signals[k, i, j] = y[i, j]
        for i in range(last.size):
            samples.status[k, i] = last[i]


@inlined
def _observe(loop: _Loop, samples: _Samples, k: int, elapsed: float) -> None:
    """Record the motion of the arm at sample k, and the desired motion `elapsed` (s) after the reference began."""
    arm = loop.robot.arm
    evaluate_motion(loop.motion, elapsed, samples.reference[k])
    for j in range(arm.position.size):
        samples.position[k, j] = arm.position[j]
        samples.velocity[k, j] = arm.derivatives[0, j]


@inlined
def _refer(loop: _Loop, desired: Array) -> None:
    """Pass a reference to the controller; `desired` is in the order of the trajectory, shape (3, joints)."""
    reference = loop.state.reference
    for i in range(3):
        for j in range(reference.shape[1]):
            reference[i, j] = desired[i, loop.places[1, j]]


@inlined
def _answer(loop: _Loop, sample: int, referred: int, measured: Array, derivatives: Array, applied: Array) -> None:
    """Run one step of the controller; its command is in ``loop.state.torque``, in the order of the simulator.

    Args:
        loop: the loop, which is read and changed.
        sample: sample at which the measurement was acquired.
        referred: stamp of the last reference, ns.
        measured: see `sense`.
        derivatives: likewise.
        applied: likewise.
    """
    state, places = loop.state, loop.places
    for j in range(measured.size):
        place = places[0, j]
        state.measured[j] = measured[place]
        if loop.controller.feeds_back:
            state.applied[j] = applied[place]
        state.truth[0, j] = derivatives[0, place]
        state.truth[1, j] = derivatives[1, place]
    step(loop.controller, state, sample * loop.period, referred, state.truth)
    for j in range(measured.size):
        state.torque[places[0, j]] = state.output[j]


@njit
def _simulate(loop: _Loop, draws: Array, samples: _Samples) -> int:
    """Run the loop; return the number of samples with finite values.

    Args:
        loop: the loop, which is read and changed.
        draws: random numbers of `Randomness`, one row per sample.
        samples: result.
    """
    period, arm, state = loop.period, loop.robot.arm, loop.state
    dt = seconds(period)
    last = -1  # sample of the last measurement that reached the controller
    begun = 0  # sample at which the reference begins: that of the first measurement that is not lost
    referred = -1  # stamp of the last reference
    for k in range(samples.time.size):
        for j in range(arm.position.size):
            if not math.isfinite(arm.position[j]):
                return k
        t = seconds(k * period)
        samples.time[k] = t
        # Divisions are the most expensive operations here.
        elapsed = t if begun == 0 else seconds((k - begun) * period)
        _observe(loop, samples, k, elapsed)
        sample, measured, derivatives, applied = sense(loop.hardware, loop.robot, draws[k], k)
        if sample >= 0:
            if last < 0 and sample > 0:
                begun = sample
                for i in range(k + 1):
                    evaluate_motion(loop.motion, seconds((i - begun) * period), samples.reference[i])
            if sample > last + 1:
                _keep(samples, last + 1, sample, state)
            if sample < k:
                elapsed = seconds((sample - begun) * period)
            if not drops_out(loop.motion, elapsed):
                referred = sample * period
                _refer(loop, samples.reference[sample])
            _answer(loop, sample, referred, measured, derivatives, applied)
            _keep(samples, sample, sample + 1, state)
            last = sample
        act(loop.hardware, loop.robot, draws[k], k, sample >= 0, state.torque, t, dt)
        for j in range(arm.position.size):
            samples.effort[k, j] = arm.effort[j]
    _keep(samples, last + 1, samples.time.size, state)
    return samples.time.size


def resolve_nodes(
    schemas: Mapping[str, Schema], settings: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Value]]:
    """Complete and check the parameters of every node; see `resolve`.

    If the joints of the trajectory are not given, they are those of the controller.

    Args:
        schemas: by node, for the nodes ``controller``, ``simulator`` and ``trajectory``.
        settings: parameters that differ from their defaults, by node.

    Raises:
        ParameterError: an unknown node or parameter, a refused value, or nodes whose joints have different names. The
            message begins with the node if it is known.
    """
    for node in settings:
        if node not in schemas:
            raise ParameterError(f"unknown node {node}; known are {', '.join(schemas)}")
    values: dict[str, dict[str, Value]] = {}
    for node, schema in schemas.items():
        given = dict(settings.get(node, {}))
        if node == "trajectory" and "joints" not in given:
            given["joints"] = list(names(values["controller"]["joints"]))
        try:
            count = _JOINTS[node](given)
            if node == "trajectory" and "joints" not in settings.get(node, {}) and count != len(given["joints"]):
                raise ParameterError(
                    f"reference.name: this reference moves {count} joints, and the robot has {len(given['joints'])}; "
                    "choose another reference, or a scenario for this robot",
                    "reference.name",
                )
            values[node] = resolve(schema, given, count)
        except ParameterError as error:
            raise ParameterError(f"{node}: {error}", f"{node}.{error.parameter}") from None
    of_the_controller = names(values["controller"]["joints"])
    for node, resolved in values.items():
        joints = names(resolved["joints"])
        if set(joints) != set(of_the_controller):
            raise ParameterError(
                f"{node}: joints are {', '.join(joints)}; those of the controller are {', '.join(of_the_controller)}. "
                "The nodes match joints by name",
                f"{node}.joints",
            )
    return values


class DivergedError(RuntimeError):
    """A value of the loop is no longer finite; the message gives the time."""


def rollout(settings: Mapping[str, Mapping[str, Any]], duration: float) -> Rollout:
    """Simulate the closed loop.

    Args:
        settings: parameters that differ from their defaults, by node (``controller``, ``simulator``,
            ``trajectory``) and full name, such as ``{"controller": {"law.k1": 3.0}}``; they take precedence
            over `EXPERIMENT`.
        duration: s.

    Raises:
        ParameterError: a setting that a schema refuses, nodes whose joints differ, a start that the controller
            refuses, a duration that is no finite time of at least one sample, or a rollout that does not fit in memory.
        DivergedError: a value of the loop is no longer finite.
    """
    values = resolve_nodes(SCHEMAS, {**settings, **{n: {**EXPERIMENT[n], **settings.get(n, {})} for n in SCHEMAS}})
    controller = Controller(values["controller"])
    robot = SimulatedRobot(values["simulator"], ESTIMATORS[str(values["controller"]["estimator.name"])].needs_truth)
    motion = ReferenceMotion(values["trajectory"])
    joints = {node: names(values[node]["joints"]) for node in SCHEMAS}
    places = np.array([JointOrder(joints["controller"]).match(joints[node]) for node in ("simulator", "trajectory")])
    _check_start(controller, robot, motion, places)
    period = period_nanoseconds(int(as_float(values["simulator"]["rate"])))
    if not duration * 1e9 / period >= 0.5 or duration == math.inf:
        raise ParameterError(f"duration: {duration} s is not a time of at least one sample")
    count = round(duration * 1e9 / period)
    samples = _blank(len(joints["simulator"]), count)
    loop = _Loop(controller.config, controller.state, robot.config, robot.state, motion.config, places, period)
    done = _simulate(loop, robot.randomness.draw(count), samples)
    if done < count:
        raise DivergedError(f"the loop is not finite any more after {seconds(done * period):g} s")
    result = Rollout(joints["simulator"], *samples, robot_parameters(values["simulator"]))
    for node, table in (("controller", result.signals), ("trajectory", result.reference)):
        if joints[node] != result.joints:
            table[:] = table[..., JointOrder(result.joints).match(joints[node])]
    # Counted from 1, because 0 means no single joint.
    of_the_result = np.array([0, *(result.joints.index(joint) + 1 for joint in joints["controller"])])
    result.status[:, Status.FAULT_JOINT] = of_the_result[result.status[:, Status.FAULT_JOINT]]
    return result


def _check_start(controller: Controller, robot: SimulatedRobot, motion: ReferenceMotion, places: Places) -> None:
    """Check that the controller accepts the start.

    Raises:
        ParameterError: the arm starts too far from its reference.
    """
    begin = np.zeros((3, robot.joints))
    motion.evaluate(0.0, begin)
    controller.position[:] = robot.state.arm.position[places[0]]
    controller.reference[:] = begin[:, places[1]]
    if refusal := controller.refusal(referred=not motion.drops_out(0.0)):
        raise ParameterError(f"simulator: initial_position: {refusal}", "simulator.initial_position")


def _blank(joints: int, count: int) -> _Samples:
    """Allocate the arrays for the samples.

    Raises:
        ParameterError: they do not fit in memory.
    """
    # Including the random numbers.
    size = count * (8 * (1 + joints * (3 + 3 + len(Signal)) + 5 + joints) + len(Status))
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if size > memory:
        raise ParameterError(
            f"duration: a rollout of {count} samples takes {size / 1e9:.3g} GB of memory; this machine has "
            f"{memory / 1e9:.3g} GB"
        )
    return _Samples(
        time=np.empty(count),
        position=np.empty((count, joints)),
        velocity=np.empty((count, joints)),
        effort=np.empty((count, joints)),
        reference=np.empty((count, 3, joints)),
        signals=np.empty((count, len(Signal), joints)),
        status=np.empty((count, len(Status)), dtype=np.uint8),
    )
