"""The simulated robot: true state -> sensor -> channel -> (controller) -> channel -> actuator -> dynamics.

One sample is `sense`, then the controller's step, then `act`.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.compiling.memory import Layout
from pidtsm_core.parameters import Parameter, Value, as_float, joint_array, resolve
from pidtsm_core.robots import GRAVITY, find_robot, inverse_dynamics, make_model
from pidtsm_core.simulation import actuator, channel, current_loop, drivetrain_step, friction, plant, randomness, sensor
from pidtsm_core.simulation.actuator import actuator_config, drive
from pidtsm_core.simulation.brakes import COMMAND_TIMEOUT, brake, brakes_state, patience_of, watch
from pidtsm_core.simulation.channel import (
    arrived,
    channel_config,
    channel_state,
    loses,
    place,
)
from pidtsm_core.simulation.contacts import bodies_that_can_touch, contact_wrenches
from pidtsm_core.simulation.current_loop import current_loop_config, current_loop_state, follow, rest
from pidtsm_core.simulation.plant import Plant, plant_schema, step
from pidtsm_core.simulation.plant_state import PlantConfig, PlantState
from pidtsm_core.simulation.randomness import Column, Randomness, columns
from pidtsm_core.simulation.sensor import measure, measure_effort, sensor_config
from pidtsm_core.simulation.simulator_state import SimulatorConfig, SimulatorState
from pidtsm_core.timing import period_nanoseconds, seconds


def simulator_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the simulated robot; they depend on the robot."""
    return (
        *plant_schema(settings),
        GRAVITY,
        *sensor.PARAMETERS,
        *channel.PARAMETERS,
        COMMAND_TIMEOUT,
        *actuator.PARAMETERS,
        *current_loop.PARAMETERS,
        *randomness.PARAMETERS,
    )


class SimulatorMemory(NamedTuple):
    """All that the simulated robot's compiled code reads and changes."""

    config: SimulatorConfig
    state: SimulatorState
    measured: Array  # result of `_sense_now`, shape (joints,), rad
    applied: Array  # likewise: the effort that the drives report, shape (joints,), N m


def _example() -> SimulatorMemory:
    return SimulatedRobot(resolve(simulator_schema, {}, 2)).memory


_LAYOUT = Layout(_example)
_memory_at = _LAYOUT.at
part = PartOf(lambda: _example().config, lambda: _example().state)
"""Decorates a function of the simulated robot that is compiled on its own, see `PartOf`."""


def _measured_side(config: PlantConfig, arm: PlantState) -> Array:
    """The positions that the encoders measure: of the links, or of the motors, shape (joints,), rad."""
    return arm.drivetrain.motor if config.drivetrain.on_motor else arm.position


@part
def _acquire(config: SimulatorConfig, state: SimulatorState, draws: Array, sample: int) -> int:
    """Measure the arm and send the measurement through its channel; return the sample whose measurement may arrive."""
    channel, arm = state.measurements, state.arm
    slot = place(channel, sample)
    packet = channel.packets[slot]
    if config.plant.drivetrain.on_motor:
        measure(config.sensor, state.motor, arm.drivetrain.motor, arm.drivetrain.motor_velocity, draws, packet[0])
    else:
        measure(config.sensor, state.motor, arm.position, arm.derivatives[0], draws, packet[0])
    for i in range(2):
        for j in range(arm.position.size):
            packet[1 + i, j] = arm.derivatives[i, j]
    transmitted = arm.drivetrain.transmitted if config.plant.drivetrain.substeps > 0 else arm.effort
    measure_effort(config.sensor, arm.effort, transmitted, draws, packet[3])
    if not loses(config.measurements, channel, sample, draws[Column.MEASUREMENT_LOSS], draws[Column.MEASUREMENT_BURST]):
        channel.sent[slot] = sample
    return sample - channel.sent.size + 1


@inlined
def sense(config: SimulatorConfig, state: SimulatorState, draws: Array, sample: int) -> tuple[int, Array, Array, Array]:
    """Measure the arm, and return the measurement that reaches the controller at this sample.

    Args:
        config: parameters.
        state: state, modified.
        draws: row of `Randomness` for this sample.
        sample: index of the sample, from 0.

    Returns:
        The sample at which the arriving measurement was acquired, -1 if none arrives; measured q, shape (joints,), rad;
        true q' and q'' of that sample, shape (2, joints); the effort applied before it, as reported by the drives,
        shape (joints,), N m.
    """
    arm, channel = state.arm, state.measurements
    if config.sensor.ideal and config.measurements.direct:
        if config.plant.drivetrain.on_motor:
            return sample, arm.drivetrain.motor, arm.derivatives, arm.effort
        return sample, arm.position, arm.derivatives, arm.effort
    acquired = _acquire(config, state, draws, sample)
    packet = channel.packets[place(channel, acquired)]
    return acquired if arrived(channel, acquired) else -1, packet[0], packet[1:3], packet[3]


@njit
def _sense_now(address: int, draws: Array, sample: int) -> int:
    """`sense` for Python, which must not receive views created by compiled code; `address`: of `SimulatorMemory`."""
    memory = _memory_at(address)
    acquired, q, _, effort = sense(memory.config, memory.state, draws, sample)
    for j in range(q.size):
        memory.measured[j] = q[j]
        memory.applied[j] = effort[j]
    return acquired


@inlined
def _take(state: SimulatorState, effort: Array) -> None:
    """Accept a command."""
    for j in range(effort.size):
        state.command[j] = effort[j]
    state.brakes.released[0] = True


@part
def _brake(config: SimulatorConfig, state: SimulatorState, t: float, dt: float) -> None:
    """Move the arm with engaged brakes, see `brake`; the drives deliver no torque."""
    brake(config.plant, state.arm, t, dt)
    rest(state.current)
    for j in range(state.lagging.size):
        state.lagging[j] = 0.0


@part
def _add_gravity(config: SimulatorConfig, state: SimulatorState, command: Array) -> None:
    """Write the command plus the effort that carries the arm, by the firmware's model, to ``state.gravity[1]``."""
    total = state.gravity
    for j in range(command.size):
        total[0, j] = 0.0
    q = state.arm.drivetrain.motor if config.plant.drivetrain.on_motor else state.arm.position
    inverse_dynamics(config.firmware, q, total[0], total[:1], total[1:])
    for j in range(command.size):
        total[1, j] += command[j]


@part
def _deliver(
    config: SimulatorConfig, state: SimulatorState, draws: Array, sample: int, commanded: bool, effort: Array
) -> bool:
    """Send a command through its channel, and accept the one that arrives; return whether one does."""
    channel = state.commands
    lost = loses(config.commands, channel, sample, draws[Column.COMMAND_LOSS], draws[Column.COMMAND_BURST])
    if commanded and not lost:
        slot = place(channel, sample)
        channel.sent[slot] = sample
        for j in range(effort.size):
            channel.packets[slot, 0, j] = effort[j]
    sent = sample - channel.sent.size + 1
    arrives = arrived(channel, sent)
    if arrives:
        _take(state, channel.packets[place(channel, sent), 0])
    return arrives


@inlined
def act(
    config: SimulatorConfig,
    state: SimulatorState,
    draws: Array,
    sample: int,
    commanded: bool,
    effort: Array,
    t: float,
    dt: float,
) -> None:
    """Move the arm over the sample; engaged brakes stop it, and hold it until a command has arrived.

    Args:
        config: parameters.
        state: state, modified.
        draws: row of `Randomness` for this sample.
        sample: index of the sample, from 0.
        commanded: whether the controller has sent a command since the last sample.
        effort: the last command sent, shape (joints,), N m.
        t: time of the sample, s.
        dt: time until the next sample, s.
    """
    torque, arrives = effort, commanded
    if config.commands.direct:
        if commanded:
            _take(state, effort)
    else:
        arrives = _deliver(config, state, draws, sample, commanded, effort)
        torque = state.command
    watch(config.patience, state.brakes, arrives)
    if state.brakes.released[0]:
        if config.adds_gravity:
            _add_gravity(config, state, torque)
            torque = state.gravity[1]
        if not config.current.ideal:
            follow(config.current, state.current, torque)
            torque = state.current.mean
        if not config.actuator.ideal:
            drive(config.actuator, state.lagging, torque, state.arm.position, draws, state.effort)
            torque = state.effort
        step(config.plant, state.arm, torque, t, dt)
    else:
        _brake(config, state, t, dt)


@njit
def _act_now(address: int, draws: Array, sample: int, commanded: bool, effort: Array, t: float, dt: float) -> None:
    """`act` for Python; `address`: of `SimulatorMemory`."""
    memory = _memory_at(address)
    act(memory.config, memory.state, draws, sample, commanded, effort, t, dt)


class SimulatedRobot:
    """A simulated robot, built from checked parameters.

    Attributes:
        joints: number of joints.
        config, state: arguments of `sense` and `act`.
        applied: effort reported by the drives with the last measurement, shape (joints,), N m.
        randomness: source of their `draws`.
    """

    def __init__(self, values: Mapping[str, Value], accelerations: bool = True) -> None:
        """Build the robot.

        Args:
            values: every parameter of `simulator_schema`, as returned by `resolve`.
            accelerations: compute true q'', see `Plant`.

        Raises:
            ParameterError: see `Plant`.
        """
        self._plant = Plant(values, accelerations)
        self.joints = joints = self._plant.joints
        self._period = period_nanoseconds(int(as_float(values["rate"])))
        self._dt = seconds(self._period)
        self._configure(values)
        self.state = SimulatorState(
            measurements=channel_state(values, "", 4, joints),
            commands=channel_state(values, "command_", 1, joints),
            command=np.zeros(joints),
            brakes=brakes_state(),
            motor=_measured_side(self._plant.config, self._plant.state).copy(),
            current=current_loop_state(joints),
            lagging=np.zeros(joints),
            effort=np.zeros(joints),
            gravity=np.zeros((2, joints)),
            arm=self._plant.state,
        )
        self.randomness = Randomness(values, joints)
        self._draws = np.zeros(columns(joints))
        self._measured, self.applied = np.zeros(joints), np.zeros(joints)
        self._memory = _LAYOUT.store(self.memory)

    @property
    def memory(self) -> SimulatorMemory:
        """What compiled code reads and changes."""
        return SimulatorMemory(self.config, self.state, self._measured, self.applied)

    def _configure(self, values: Mapping[str, Value]) -> None:
        robot = find_robot(values)
        self.config = SimulatorConfig(
            sensor=sensor_config(values, self.joints),
            measurements=channel_config(values, ""),
            commands=channel_config(values, "command_"),
            patience=patience_of(values, self._period),
            current=current_loop_config(values, self.joints),
            actuator=actuator_config(values, self.joints),
            adds_gravity=values[GRAVITY.name] == "added_by_robot",
            firmware=make_model(robot, robot.pack_model(values)),
            plant=self._plant.config,
        )

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other parameters from the next sample on; the state is kept."""
        self._plant.set_parameters(values)
        self._configure(values)
        self._memory.write(self.memory)
        self.randomness.set_parameters(values)

    def compile(self) -> None:
        """Compile everything that `sense` and `act` may call, so that no parameter change delays a node.

        This moves the arm.
        """
        _sense_now(self._memory.address, self._draws, 0)
        _act_now(self._memory.address, self._draws, 0, True, self.state.effort, 0.0, self._dt)
        for each in (part, actuator.part, current_loop.part, friction.part, drivetrain_step.part, plant.part):
            each.prepare()

    @property
    def silence(self) -> int:
        """Samples since the last one with a command, inclusive; 0: none yet."""
        return int(self.state.brakes.silence[0])

    @property
    def braked(self) -> bool:
        """Whether the brakes are engaged."""
        return not self.state.brakes.released[0]

    @property
    def diverged(self) -> bool:
        """Whether a position or velocity is no longer finite: the arm moves too fast for the integration step."""
        arm, drives = self.state.arm, self.state.arm.drivetrain
        return not math.isfinite(arm.position @ arm.derivatives[0] + drives.motor @ drives.motor_velocity)

    def push(self, wrench: Array) -> None:
        """From the next sample on, act on the tool with force (N) and torque (N m) in the axes of the base.

        `wrench` has shape (6,); zeros end the push.
        """
        self.state.arm.wrench[0] = wrench

    @property
    def touchable(self) -> tuple[str, ...]:
        """Names of the arm's bodies that can touch something: of those with a shape, on the engine MuJoCo."""
        return bodies_that_can_touch(self._plant.mujoco.models) if self._plant.mujoco else ()

    def contacts(self) -> dict[str, Array]:
        """By name of the body, the wrench of its contacts at the end of the last sample; see `contact_wrenches`."""
        mujoco = self._plant.mujoco
        return contact_wrenches(mujoco.models, mujoco.data) if mujoco else {}

    def reset(self, values: Mapping[str, Value]) -> None:
        """Put the arm at its initial position, at rest, with engaged brakes; time and messages in transit are kept.

        Args:
            values: parameters of the robot; only ``initial_position`` is used.
        """
        self._plant.reset()
        self._plant.rest(joint_array(values["initial_position"], self.joints))
        self.state.motor[:] = _measured_side(self.config.plant, self.state.arm)
        self.state.lagging[:] = 0.0
        rest(self.state.current)
        self.state.brakes.released[0] = False
        self.state.brakes.silence[0] = 0

    def sense(self, sample: int) -> tuple[int, Array]:
        """Begin a sample; call it once for every sample, in order.

        Returns:
            The sample at which the measurement that reaches the controller was acquired, -1 if none arrives; measured
            q, shape (joints,), rad, valid until the next call.
        """
        self._draws = self.randomness.next()
        return _sense_now(self._memory.address, self._draws, sample), self._measured

    def act(self, sample: int, commanded: bool, effort: Array) -> None:
        """Move the arm to the next sample, see `act`."""
        t = seconds(sample * self._period)
        _act_now(self._memory.address, self._draws, sample, commanded, effort, t, self._dt)
