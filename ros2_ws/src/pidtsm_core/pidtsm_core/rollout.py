"""The closed loop without ROS: the same compiled functions as the nodes, in one compiled loop."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiled import njit
from pidtsm_core.control import Controller, ControllerConfig, ControllerState, controller_schema, step
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.joints import JointOrder
from pidtsm_core.parameters import Array, ParameterError, Schema, Value, names, number, resolve
from pidtsm_core.references import (
    MotionConfig,
    ReferenceMotion,
    drops_out,
    evaluate_motion,
    reference_joints,
    reference_schema,
)
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Signal, Status
from pidtsm_core.simulator import SimulatedRobot, SimulatorConfig, SimulatorState, act, sense, simulator_schema
from pidtsm_core.timing import period_nanoseconds, seconds

SCHEMAS = {"controller": controller_schema, "simulator": simulator_schema, "trajectory": reference_schema}
"""Parameters of each node that change a torque: those of a rollout."""
_JOINTS = {"controller": robot_joints, "simulator": robot_joints, "trajectory": reference_joints}

EXPERIMENT: Mapping[str, Mapping[str, Value]] = {
    "simulator": {"command.timeout": 1.0},
    "controller": {"activation.blend": 0.0, "watchdog.state_stop": 1.0},
    "trajectory": {},
}
"""What an experiment sets, be it a run or a rollout, where its settings do not: it measures the law, from its first
sample on, and not how a watchdog ends it."""

Places = NDArray[np.int64]


@dataclass(frozen=True)
class Rollout:
    """What a closed loop did; row k of every array belongs to time[k].

    Attributes:
        joints: names, in the order of the simulator.
        time: s, shape (samples,).
        position, velocity: true q (rad), q' (rad/s), shape (samples, joints).
        effort: torque applied from time[k] on, N m, shape (samples, joints).
        reference: q_d, q_d', q_d'', shape (samples, 3, joints).
        signals: what the controller computed from the measurement of this sample, or last where none reached it,
            shape (samples, len(Signal), joints), order of `Signal`.
        status: likewise what it said of itself, shape (samples, len(Status)), order of `Status`.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array
    status: NDArray[np.uint8]


@njit
def _keep(
    signals: Array, status: NDArray[np.uint8], start: int, stop: int, controller: ControllerState, places: Places
) -> None:
    """Fill rows with what the controller computed last; `places` are its joints' in the rows."""
    y, last = controller.signals, controller.status
    for k in range(start, stop):
        for i in range(y.shape[0]):
            for j in range(y.shape[1]):
                signals[k, i, places[j]] = y[i, j]
        for i in range(last.size):
            status[k, i] = last[i]


@njit
def _simulate(
    controller: ControllerConfig,
    memory: ControllerState,
    hardware: SimulatorConfig,
    robot: SimulatorState,
    draws: Array,
    motion: MotionConfig,
    places: Places,
    arranged: Array,
    period: int,
    time: Array,
    position: Array,
    velocity: Array,
    effort: Array,
    desired: Array,
    signals: Array,
    status: NDArray[np.uint8],
) -> int:
    """Run the loop; returns the number of samples done before a value stopped being finite.

    `places` are the controller's and the reference's joints among the simulator's, shape (2, joints); `arranged` is
    scratch for what is brought from one order to another, shape (6, joints).
    """
    dt = seconds(period)
    arm = robot.arm
    joints = position.shape[1]
    last = -1  # sample of the last measurement that reached the controller
    begun = 0  # sample at which the reference begins: that of the first measurement that is not lost
    referred = -1  # stamp of the last reference
    truth, torque = arranged[3:5], arranged[5]
    for k in range(position.shape[0]):
        for j in range(joints):
            if not math.isfinite(arm.position[j]):
                return k
        t = seconds(k * period)
        time[k] = t
        _refer(motion, seconds((k - begun) * period), places[1], arranged, desired[k])
        for j in range(joints):
            position[k, j] = arm.position[j]
            velocity[k, j] = arm.derivatives[0, j]
        sample, measured, derivatives = sense(hardware, robot, draws[k], k)
        if sample >= 0:
            if last < 0 and sample > 0:
                begun = sample
                for i in range(k + 1):
                    _refer(motion, seconds((i - begun) * period), places[1], arranged, desired[i])
            if sample > last + 1:
                _keep(signals, status, last + 1, sample, memory, places[0])
            stamp = sample * period
            received = not drops_out(motion, seconds((sample - begun) * period))
            if received:
                referred = stamp
            for j in range(joints):
                place = places[0, j]
                memory.measured[j] = measured[place]
                for i in range(2):
                    truth[i, j] = derivatives[i, place]
                if received:
                    for i in range(3):
                        memory.reference[i, j] = desired[sample, i, place]
            step(controller, memory, stamp, referred, truth)
            for j in range(joints):
                torque[places[0, j]] = memory.signals[Signal.EFFORT, j]
            _keep(signals, status, sample, sample + 1, memory, places[0])
            last = sample
        act(hardware, robot, draws[k], k, sample >= 0, torque, t, dt)
        for j in range(joints):
            effort[k, j] = arm.effort[j]
    _keep(signals, status, last + 1, position.shape[0], memory, places[0])
    return position.shape[0]


@njit
def _refer(motion: MotionConfig, t: float, places: Places, arranged: Array, desired: Array) -> None:
    """Write the reference at t (s) in the order of the simulator's joints; `places` are its own among those."""
    evaluate_motion(motion, t, arranged[:3])
    for i in range(3):
        for j in range(places.size):
            desired[i, places[j]] = arranged[i, j]


def resolve_nodes(
    schemas: Mapping[str, Schema], settings: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Value]]:
    """Every parameter of every node, checked; see `resolve`.

    The joints of the trajectory follow those of the controller, where they are not given.

    Args:
        schemas: by node, for the nodes ``controller``, ``simulator`` and ``trajectory``.
        settings: parameters that differ from their defaults, by node.

    Raises:
        ParameterError: an unknown node or parameter, a refused value, or nodes whose joints have different names; the
            message begins with the node.
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
            values[node] = resolve(schema, given, _JOINTS[node](given))
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
    """A value of the loop stopped being finite; the message says when."""


def rollout(settings: Mapping[str, Mapping[str, Any]], duration: float) -> Rollout:
    """Simulate the closed loop.

    Args:
        settings: parameters that differ from their defaults, by node (``controller``, ``simulator``,
            ``trajectory``) and full name, such as ``{"controller": {"law.k1": 3.0}}``. Where they say nothing,
            `EXPERIMENT` holds.
        duration: s.

    Raises:
        ParameterError: a setting that a schema refuses, nodes whose joints differ, a start that the controller
            refuses, or a rollout that does not fit in memory.
        DivergedError: the loop left the finite numbers.
    """
    values = resolve_nodes(SCHEMAS, {node: {**EXPERIMENT.get(node, {}), **settings.get(node, {})} for node in
                                     dict.fromkeys([*SCHEMAS, *settings])})
    controller = Controller(values["controller"])
    robot = SimulatedRobot(values["simulator"], ESTIMATORS[str(values["controller"]["estimator.name"])].needs_truth)
    motion = ReferenceMotion(values["trajectory"])
    period = period_nanoseconds(int(number(values["simulator"]["rate"])))
    if not duration * 1e9 / period >= 0.5 or duration == math.inf:
        raise ParameterError(f"duration: {duration} s is not a time of at least one sample")
    samples = round(duration * 1e9 / period)
    result = _blank(names(values["simulator"]["joints"]), samples)
    order = JointOrder(result.joints)
    places = np.array([np.argsort(order.match(names(values[node]["joints"]))) for node in ("controller", "trajectory")])
    done = _simulate(
        controller.config,
        controller.state,
        robot.config,
        robot.state,
        robot.randomness.draw(samples),
        motion.config,
        places,
        np.zeros((6, robot.joints)),
        period,
        result.time,
        result.position,
        result.velocity,
        result.effort,
        result.reference,
        result.signals,
        result.status,
    )
    if done < samples:
        raise DivergedError(f"the loop is not finite any more after {seconds(done * period):g} s")
    return result


def _blank(joints: tuple[str, ...], samples: int) -> Rollout:
    """Room for a result.

    Raises:
        ParameterError: there is none.
    """
    count = len(joints)
    # With the random numbers.
    size = samples * (8 * (1 + count * (3 + 3 + len(Signal)) + 5 + count) + len(Status))
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if size > memory:
        raise ParameterError(
            f"duration: a rollout of {samples} samples takes {size / 1e9:.3g} GB of memory; this machine has "
            f"{memory / 1e9:.3g} GB"
        )
    return Rollout(
        joints=joints,
        time=np.empty(samples),
        position=np.empty((samples, count)),
        velocity=np.empty((samples, count)),
        effort=np.empty((samples, count)),
        reference=np.empty((samples, 3, count)),
        signals=np.empty((samples, len(Signal), count)),
        status=np.empty((samples, len(Status)), dtype=np.uint8),
    )
