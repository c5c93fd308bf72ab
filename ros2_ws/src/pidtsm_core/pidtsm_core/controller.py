"""The controller: estimator, law, robot model and torque limits as one compiled tick."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.compiled import inlined, njit
from pidtsm_core.estimators import ESTIMATORS, Sample, estimate
from pidtsm_core.family import SLOTS
from pidtsm_core.laws import LAW_NUMBERS, LAWS, STATE_SLOTS, Numbers, advance, command, kernel_number
from pidtsm_core.parameters import Array, Parameter, Value, chosen, joint_array, prefixed
from pidtsm_core.robots import ROBOTS, inverse_dynamics, robot_schema
from pidtsm_core.signals import Signal

LAW_NAME = Parameter("law.name", "piddtsm", "control law", choices=LAWS.names, fixed=True)
ESTIMATOR_NAME = Parameter(
    "estimator.name", "filtered_difference", "state estimator", choices=ESTIMATORS.names, fixed=True
)


def controller_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the controller; ``law.name``, ``estimator.name`` and ``robot.name`` decide which there are."""
    law = LAWS[chosen(settings, LAW_NAME)]
    estimator = ESTIMATORS[chosen(settings, ESTIMATOR_NAME)]
    return (
        LAW_NAME,
        *prefixed("law", law.parameters(settings)),
        ESTIMATOR_NAME,
        *prefixed("estimator", estimator.parameters),
        *robot_schema(settings),
    )


class ControllerConfig(NamedTuple):
    """What a tick reads; the numbers are places in the registries."""

    robot: int
    kernel: int
    estimator: int
    uses_model: bool
    freeze_saturated: bool
    law_numbers: Numbers  # shape (LAW_NUMBERS,)
    model: Array  # shape (model parameters,)
    law: Array  # shape (joints, law parameters)
    estimator_parameters: Array  # shape (joints, SLOTS)
    effort_limit: Array  # shape (joints,), N m


class ControllerState(NamedTuple):
    """What a tick changes; all zero at the start."""

    estimator: Array  # shape (joints, SLOTS)
    law: Array  # shape (joints, STATE_SLOTS)
    signals: Array  # shape (len(Signal), joints): see Signal
    accelerations: Array  # scratch: a_eq, a_cmd, shape (2, joints)


_SIGNALS = len(Signal)
_BEFORE_LAW = 8  # Of the numbers, see `parts`.


def memory_size(joints: int, model: int, law: int) -> int:
    """Length of the memory of `parts`, for a model and a law (of one joint) with so many parameters."""
    return model + joints * (law + SLOTS + 1 + SLOTS + STATE_SLOTS + _SIGNALS + 2)


@inlined
def parts(memory: Array, numbers: Numbers) -> tuple[ControllerConfig, ControllerState]:
    """A controller's configuration and state as views of its memory.

    A node calls compiled code a thousand times a second with the processor's caches cold; each array among the
    arguments then costs about a microsecond. So all of a controller stands in two arrays.

    Args:
        memory: shape (memory_size,).
        numbers: joints, lengths of model and law, robot, kernel, estimator, uses_model, freeze_saturated, law_numbers.
    """
    joints, model, law = numbers[0], numbers[1], numbers[2]
    a = model
    b = a + joints * law
    c = b + joints * SLOTS
    d = c + joints
    e = d + joints * SLOTS
    f = e + joints * STATE_SLOTS
    g = f + joints * _SIGNALS
    config = ControllerConfig(
        robot=numbers[3],
        kernel=numbers[4],
        estimator=numbers[5],
        uses_model=numbers[6] != 0,
        freeze_saturated=numbers[7] != 0,
        law_numbers=numbers[_BEFORE_LAW : _BEFORE_LAW + LAW_NUMBERS],
        model=memory[:a],
        law=memory[a:b].reshape((joints, law)),
        estimator_parameters=memory[b:c].reshape((joints, SLOTS)),
        effort_limit=memory[c:d],
    )
    state = ControllerState(
        estimator=memory[d:e].reshape((joints, SLOTS)),
        law=memory[e:f].reshape((joints, STATE_SLOTS)),
        signals=memory[f:g].reshape((_SIGNALS, joints)),
        accelerations=memory[g : g + 2 * joints].reshape((2, joints)),
    )
    return config, state


@njit
def tick(config: ControllerConfig, state: ControllerState, q: Array, truth: Array, desired: Array, dt: float) -> None:
    """One control period: writes every signal, the commanded effort among them, to ``state.signals``.

    Args:
        config: what the tick reads.
        state: what it changes.
        q: measured positions, shape (joints,), rad.
        truth: true q', q'' for an estimator that `needs_truth`, shape (2, joints), else ignored.
        desired: q_d, q_d', q_d'', shape (3, joints), rad, rad/s, rad/s^2.
        dt: time since the last tick, s; 0 at the first.

    Absurd positions that overflow give no torque, never one that is not finite.
    The states of the law first move over dt with the values of the last tick, eqs. (10), (25), (27); so an
    irregular period integrates what was really held over it.
    """
    joints = q.size
    y = state.signals
    if dt > 0.0:
        for j in range(joints):
            advance(
                config.kernel,
                y[Signal.POSITION_ERROR, j],
                y[Signal.SLIDING_VARIABLE, j],
                y[Signal.MANIFOLD_VARIABLE, j],
                config.law_numbers,
                config.law[j],
                state.law[j],
                dt,
                config.freeze_saturated and y[Signal.SATURATED, j] != 0.0,
            )

    sample = Sample(q, truth, dt, y[Signal.EFFORT], config.robot, config.model)
    estimate(config.estimator, sample, config.estimator_parameters, state.estimator, y[: Signal.POSITION_ERROR])

    for j in range(joints):
        e = y[Signal.POSITION, j] - desired[0, j]
        de = y[Signal.VELOCITY, j] - desired[1, j]
        dde = y[Signal.ACCELERATION, j] - desired[2, j]
        a_cmd, a_eq, s, sigma, gain, tau_sw = command(
            config.kernel, e, de, dde, desired[2, j], config.law_numbers, config.law[j], state.law[j], dt
        )
        y[Signal.POSITION_ERROR, j] = e
        y[Signal.VELOCITY_ERROR, j] = de
        y[Signal.SLIDING_VARIABLE, j] = s
        y[Signal.MANIFOLD_VARIABLE, j] = sigma
        y[Signal.ADAPTIVE_GAIN, j] = gain
        y[Signal.SWITCHING_TERM, j] = tau_sw
        state.accelerations[0, j] = a_eq
        state.accelerations[1, j] = a_cmd

    efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    if config.uses_model:
        q_hat, dq_hat = y[Signal.POSITION], y[Signal.VELOCITY]
        inverse_dynamics(config.robot, q_hat, dq_hat, state.accelerations, config.model, efforts)
    for j in range(joints):
        if config.uses_model:
            y[Signal.ACCELERATION_COMMAND, j] = state.accelerations[1, j]
        else:
            efforts[0, j] = state.accelerations[0, j]
            efforts[1, j] = state.accelerations[1, j]
    for j in range(joints):
        limit = config.effort_limit[j]
        effort = y[Signal.EFFORT, j]
        if math.isfinite(effort):
            y[Signal.EFFORT, j] = min(max(effort, -limit), limit)
            y[Signal.SATURATED, j] = 1.0 if abs(effort) >= limit else 0.0
        else:
            y[Signal.EFFORT, j] = 0.0
            y[Signal.SATURATED, j] = 1.0


class Controller:
    """A controller of one robot, built from checked parameters.

    Attributes:
        joints: number of joints.
        memory, numbers: what `parts` takes.
        config, state: the same as what `tick` takes.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        """Args: values: every parameter of `controller_schema`, as `resolve` returns them."""
        self.joints = len(ROBOTS[str(values["robot.name"])].joints)
        self._build(values)
        self._no_truth = np.zeros((2, self.joints))

    def _build(self, values: Mapping[str, Value]) -> None:
        robot = ROBOTS[str(values["robot.name"])]
        law = LAWS[str(values["law.name"])]
        estimator = ESTIMATORS[str(values["estimator.name"])]
        model, gains = robot.pack_model(values), law.pack(values, self.joints)
        self.numbers = np.array(
            [
                self.joints,
                model.size,
                gains.shape[1],
                ROBOTS.number(robot.name),
                kernel_number(law),
                ESTIMATORS.number(estimator.name),
                law.uses_model,
                values["law.anti_windup"] == "conditional",
                *law.numbers(values),
            ]
        )
        self.memory = np.zeros(memory_size(self.joints, model.size, gains.shape[1]))
        self.config, self.state = parts(self.memory, self.numbers)
        self.config.model[:] = model
        self.config.law[:] = gains
        self.config.estimator_parameters[:] = estimator.pack(values, "estimator", self.joints)
        self.config.effort_limit[:] = joint_array(values["limits.effort"], self.joints)

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other gains from the next tick on; the state stays."""
        before = self.state
        self._build(values)
        for now, kept in zip(self.state, before, strict=True):
            now[:] = kept

    def reset(self) -> None:
        """Back to the state of the start."""
        for array in self.state:
            array[:] = 0.0

    def step(self, q: Array, desired: Array, dt: float) -> Array:
        """One control period.

        Args:
            q: measured positions, shape (joints,), rad, finite.
            desired: q_d, q_d', q_d'', shape (3, joints), finite.
            dt: time since the last call, s, 0 at the first.

        Returns:
            The signals, shape (len(Signal), joints), order of `Signal`; overwritten by the next call.
        """
        tick(self.config, self.state, q, self._no_truth, desired, dt)
        return self.state.signals
