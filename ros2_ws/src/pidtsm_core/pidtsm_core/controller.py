"""The controller: estimator, law, robot model and torque limits as one compiled tick."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.compiled import njit
from pidtsm_core.estimators import ESTIMATORS, estimate
from pidtsm_core.family import SLOTS
from pidtsm_core.laws import LAWS, STATE_SLOTS, Numbers, advance, command, kernel_number
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
    model: Array  # shape (model parameters,)
    kernel: int
    law_numbers: Numbers  # shape (4,)
    law: Array  # shape (joints, law parameters)
    uses_model: bool
    freeze_saturated: bool
    estimator: int
    estimator_parameters: Array  # shape (joints, SLOTS)
    effort_limit: Array  # shape (joints,), N m


class ControllerState(NamedTuple):
    """What a tick changes; all zero at the start."""

    estimator: Array  # shape (joints, SLOTS)
    law: Array  # shape (joints, STATE_SLOTS)
    signals: Array  # shape (len(Signal), joints): see Signal


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

    estimate(config.estimator, q, truth, dt, config.estimator_parameters, state.estimator, y[: Signal.POSITION_ERROR])

    equivalent = y[Signal.EQUIVALENT_EFFORT]
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
        y[Signal.ACCELERATION_COMMAND, j] = a_eq
        y[Signal.EFFORT, j] = a_cmd

    # The effort row holds a_cmd for a moment, so that no tick allocates.
    q_hat, dq_hat = y[Signal.POSITION], y[Signal.VELOCITY]
    if config.uses_model:
        inverse_dynamics(config.robot, q_hat, dq_hat, y[Signal.ACCELERATION_COMMAND], config.model, equivalent)
        for j in range(joints):
            y[Signal.ACCELERATION_COMMAND, j] = y[Signal.EFFORT, j]
        inverse_dynamics(config.robot, q_hat, dq_hat, y[Signal.ACCELERATION_COMMAND], config.model, y[Signal.EFFORT])
    else:
        for j in range(joints):
            equivalent[j] = y[Signal.ACCELERATION_COMMAND, j]
            y[Signal.ACCELERATION_COMMAND, j] = 0.0
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
        config, state: what `tick` takes.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        """Args: values: every parameter of `controller_schema`, as `resolve` returns them."""
        robot = ROBOTS[str(values["robot.name"])]
        self.joints = len(robot.joints)
        self.config = self._config(values)
        self.state = ControllerState(
            estimator=np.zeros((self.joints, SLOTS)),
            law=np.zeros((self.joints, STATE_SLOTS)),
            signals=np.zeros((len(Signal), self.joints)),
        )
        self._no_truth = np.zeros((2, self.joints))

    def _config(self, values: Mapping[str, Value]) -> ControllerConfig:
        robot = ROBOTS[str(values["robot.name"])]
        law = LAWS[str(values["law.name"])]
        estimator = ESTIMATORS[str(values["estimator.name"])]
        return ControllerConfig(
            robot=ROBOTS.number(robot.name),
            model=robot.pack_model(values),
            kernel=kernel_number(law),
            law_numbers=law.numbers(values),
            law=law.pack(values, self.joints),
            uses_model=law.uses_model,
            freeze_saturated=values["law.anti_windup"] == "conditional",
            estimator=ESTIMATORS.number(estimator.name),
            estimator_parameters=estimator.pack(values, "estimator", self.joints),
            effort_limit=joint_array(values["limits.effort"], self.joints),
        )

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other gains from the next tick on; the state stays."""
        self.config = self._config(values)

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
            The signals, shape (len(Signal), joints), order of `Signal`; the same array at every call.
        """
        tick(self.config, self.state, q, self._no_truth, desired, dt)
        return self.state.signals
