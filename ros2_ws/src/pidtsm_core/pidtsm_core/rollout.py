"""The closed loop without ROS: the same compiled functions as the nodes, in one compiled loop."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.compiled import njit
from pidtsm_core.controller import Controller, ControllerConfig, ControllerState, controller_schema, tick
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.parameters import Array, ParameterError, Schema, Value, names, number, resolve
from pidtsm_core.references import ReferenceMotion, evaluate_reference, reference_joints, reference_schema
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Signal
from pidtsm_core.simulator import SimulatedRobot, SimulatorConfig, SimulatorState, act, sense, simulator_schema
from pidtsm_core.timing import period_nanoseconds, seconds

SCHEMAS = {"controller": controller_schema, "simulator": simulator_schema, "trajectory": reference_schema}
"""Parameters of each node as far as the core knows them."""
_JOINTS = {"controller": robot_joints, "simulator": robot_joints, "trajectory": reference_joints}


@dataclass(frozen=True)
class Rollout:
    """What a closed loop did; row k of every array belongs to time[k].

    Attributes:
        joints: names.
        time: s, shape (samples,).
        position, velocity: true q (rad), q' (rad/s), shape (samples, joints).
        effort: torque applied from time[k] on, N m, shape (samples, joints).
        reference: q_d, q_d', q_d'', shape (samples, 3, joints).
        signals: what the controller computed from the measurement of this sample, or said last where none reached it,
            shape (samples, len(Signal), joints), order of `Signal`.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array


@njit
def _keep(signals: Array, start: int, stop: int, last: Array) -> None:
    """Fill rows in which the controller was not asked with what it said last."""
    for k in range(start, stop):
        for i in range(last.shape[0]):
            for j in range(last.shape[1]):
                signals[k, i, j] = last[i, j]


@njit
def _simulate(
    controller: ControllerConfig,
    memory: ControllerState,
    hardware: SimulatorConfig,
    robot: SimulatorState,
    draws: Array,
    reference: int,
    reference_parameters: Array,
    period: int,
    time: Array,
    position: Array,
    velocity: Array,
    effort: Array,
    desired: Array,
    signals: Array,
) -> int:
    """Run the loop; returns the number of samples done before a value stopped being finite."""
    dt = seconds(period)
    arm = robot.arm
    last = -1  # sample of the last measurement that reached the controller
    for k in range(position.shape[0]):
        for j in range(position.shape[1]):
            if not math.isfinite(arm.position[j]):
                return k
        t = seconds(k * period)
        time[k] = t
        evaluate_reference(reference, t, reference_parameters, desired[k])
        for j in range(position.shape[1]):
            position[k, j] = arm.position[j]
            velocity[k, j] = arm.derivatives[0, j]
        sample, measured, truth = sense(hardware, robot, draws[k], k)
        if sample >= 0:
            since = seconds((sample - last) * period) if last >= 0 else 0.0
            if sample > last + 1:
                _keep(signals, last + 1, sample, memory.signals)
            tick(controller, memory, measured, truth, desired[sample], since)
            for i in range(signals.shape[1]):
                for j in range(signals.shape[2]):
                    signals[sample, i, j] = memory.signals[i, j]
            last = sample
        act(hardware, robot, draws[k], k, sample >= 0, memory.signals[Signal.EFFORT], t, dt)
        for j in range(position.shape[1]):
            effort[k, j] = arm.effort[j]
    _keep(signals, last + 1, position.shape[0], memory.signals)
    return position.shape[0]


def resolve_nodes(
    schemas: Mapping[str, Schema], settings: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Value]]:
    """Every parameter of every node, checked; see `resolve`.

    Args:
        schemas: by node, for the nodes ``controller``, ``simulator`` and ``trajectory``.
        settings: parameters that differ from their defaults, by node.

    Raises:
        ParameterError: an unknown node or parameter, or a refused value; the message begins with the node.
    """
    for node in settings:
        if node not in schemas:
            raise ParameterError(f"unknown node {node}; known are {', '.join(schemas)}")
    values = {}
    for node, schema in schemas.items():
        given = settings.get(node, {})
        try:
            values[node] = resolve(schema, given, _JOINTS[node](given))
        except ParameterError as error:
            raise ParameterError(f"{node}: {error}", f"{node}.{error.parameter}") from None
    return values


class DivergedError(RuntimeError):
    """A value of the loop stopped being finite; the message says when."""


def rollout(settings: Mapping[str, Mapping[str, Any]], duration: float) -> Rollout:
    """Simulate the closed loop.

    Args:
        settings: parameters that differ from their defaults, by node (``controller``, ``simulator``,
            ``trajectory``) and full name, such as ``{"controller": {"law.k1": 3.0}}``.
        duration: s.

    Raises:
        ParameterError: a setting that a schema refuses, or parts made for different numbers of joints.
        DivergedError: the loop left the finite numbers.
    """
    values = resolve_nodes(SCHEMAS, settings)
    controller = Controller(values["controller"])
    robot = SimulatedRobot(values["simulator"], ESTIMATORS[str(values["controller"]["estimator.name"])].needs_truth)
    motion = ReferenceMotion(values["trajectory"])
    if not controller.joints == robot.joints == motion.joints:
        raise ParameterError(
            f"controller, simulator and trajectory are made for {controller.joints}, {robot.joints} and "
            f"{motion.joints} joints"
        )
    period = period_nanoseconds(int(number(values["simulator"]["rate"])))
    if not duration * 1e9 / period >= 0.5 or duration == math.inf:
        raise ParameterError(f"duration: {duration} s is not a time of at least one sample")
    samples = round(duration * 1e9 / period)
    joints = robot.joints

    result = Rollout(
        joints=names(values["simulator"]["joints"]),
        time=np.empty(samples),
        position=np.empty((samples, joints)),
        velocity=np.empty((samples, joints)),
        effort=np.empty((samples, joints)),
        reference=np.empty((samples, 3, joints)),
        signals=np.empty((samples, len(Signal), joints)),
    )
    done = _simulate(
        controller.config,
        controller.state,
        robot.config,
        robot.state,
        robot.randomness.draw(samples),
        motion.number,
        motion.parameters,
        period,
        result.time,
        result.position,
        result.velocity,
        result.effort,
        result.reference,
        result.signals,
    )
    if done < samples:
        raise DivergedError(f"the loop is not finite any more after {seconds(done * period):g} s")
    return result
