"""The simulated arm: rigid dynamics, disturbance, friction, torque limits, payload and pushes, integrated by RK4."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.compiling.memory import Layout
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float, chosen, joint_array, prefixed, resolve
from pidtsm_core.robots import (
    NO_TOOL,
    Model,
    find_robot,
    forward_dynamics,
    make_model,
    payload_of,
    payload_schema,
    robot_schema,
)
from pidtsm_core.robots.tree import add_wrench
from pidtsm_core.simulation import drivetrain as drivetrains
from pidtsm_core.simulation import friction as joint_friction
from pidtsm_core.simulation import gear_friction
from pidtsm_core.simulation.disturbances import DISTURBANCES, add_disturbance, make_disturbance
from pidtsm_core.simulation.drivetrain import drivetrain, drivetrain_state, rest_at
from pidtsm_core.simulation.drivetrain_step import move
from pidtsm_core.simulation.friction import (
    add_friction,
    check_friction,
    friction_config,
    without_viscous,
)
from pidtsm_core.simulation.mujoco_model import ENGINE, MUJOCO, engine_schema
from pidtsm_core.simulation.mujoco_motors_step import advance_motors
from pidtsm_core.simulation.mujoco_plant import (
    MujocoArm,
    acceleration,
    advance,
    no_config,
    no_state,
)
from pidtsm_core.simulation.plant_parameters import (
    LOADS,
    MODEL_ERRORS,
    PAYLOAD,
    QUANTITIES,
    RATE,
    wrench_of,
)
from pidtsm_core.simulation.plant_state import PlantConfig, PlantState
from pidtsm_core.timing import sum_of_times


def plant_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the simulated arm; they depend on the robot and ``disturbance.name``."""
    robot = find_robot(settings)
    name = Parameter(
        "disturbance.name",
        robot.disturbance,
        "torque that acts on the arm in addition to the torque of the motors",
        choices=DISTURBANCES,
        read_only=True,
    )
    return (
        *engine_schema(settings, robot, robot_schema(settings, robot)),
        RATE,
        Parameter("initial_position", robot.initial_position, "joint positions at the start", "rad", per_joint=True),
        name,
        *prefixed("disturbance", DISTURBANCES[chosen(settings, name)].parameters),
        *payload_schema(settings, PAYLOAD, robot),
        *LOADS,
        *joint_friction.parameters(robot),
        *gear_friction.PARAMETERS,
        *drivetrains.PARAMETERS,
        *MODEL_ERRORS,
    )


@inlined
def _net_effort(config: PlantConfig, t: float, q: Array, dq: Array, effort: Array, net: Array) -> None:
    """Write the effort plus disturbance and friction at t (s) to `net`, shape (joints,), N m."""
    for j in range(effort.size):
        net[j] = effort[j]
    add_disturbance(config.disturbance, t, q, dq, net)
    if not config.friction.none:
        add_friction(config.friction, dq, net)


@inlined
def _acceleration(
    config: PlantConfig, model: Model, t: float, q: Array, dq: Array, effort: Array, net: Array, ddq: Array
) -> None:
    """ddq of eq. (5) at t (s); `net` is scratch for the torque with disturbance and friction."""
    _net_effort(config, t, q, dq, effort, net)
    forward_dynamics(model, q, dq, net, ddq)


class PlantMemory(NamedTuple):
    """All that the compiled code of a plant reads and changes."""

    config: PlantConfig
    state: PlantState


def _example() -> PlantMemory:
    return Plant(resolve(plant_schema, {}, 2)).memory


_LAYOUT = Layout(_example)
plant_at = _LAYOUT.at
"""In compiled code, the `PlantMemory` at an address."""
part = PartOf(lambda: _example().config, lambda: _example().state)


@inlined
def _is_pushed(state: PlantState) -> bool:
    """Whether a wrench from outside acts on the tool."""
    total = 0.0
    for i in range(6):
        total += abs(state.wrench[0, i])
    return total > 0.0


@part
def _push(config: PlantConfig, state: PlantState, pushes: bool, pushed: Array) -> None:
    """Write the torque with what pushes the arm, `pushes`: the push of the parameters too, shape (joints,), N m."""
    for j in range(pushed.size):
        pushed[j] = state.effort[j] + config.push[j] if pushes else state.effort[j]
    if config.tool.row < 0:
        return
    wrench = state.wrench[1]
    for i in range(6):
        wrench[i] = state.wrench[0, i] + config.wrench[i] if pushes else state.wrench[0, i]
    add_wrench(state.position, config.tool.tree, config.tool.row, config.tool.point, wrench, state.placements, pushed)


@inlined
def _phase(config: PlantConfig, t: float) -> int:
    """Where the payload is at t (s), see `Phase`."""
    if t < config.payload_begin:
        return 0
    return 1 if t < config.payload_end else 2


@part
def _step_of_mujoco(config: PlantConfig, state: PlantState, t: float, dt: float, effort: Array) -> None:
    """As `step`, by MuJoCo; disturbance and dry friction are those at the start of each of its steps."""
    q, dq, net = state.position, state.derivatives[0], state.work[0]
    phase = _phase(config, t)
    for k in range(config.mujoco.steps):
        _net_effort(config, t + k * dt / config.mujoco.steps, q, dq, effort, net)
        advance(config.mujoco, state.mujoco, phase, net, q, dq)
    if config.accelerations:
        _net_effort(config, t + dt, q, dq, effort, net)
        acceleration(config.mujoco, state.mujoco, phase, net, q, dq, state.derivatives[1])


@part
def carry(config: PlantConfig, state: PlantState, t: float) -> None:
    """One period of MuJoCo from t (s) in which the arm is where it is, whatever acts on it, and all else moves."""
    phase = _phase(config, t)
    none, q, dq = state.work[0], state.work[1], state.work[2]
    for _ in range(config.mujoco.steps):
        for j in range(none.size):
            none[j], q[j], dq[j] = 0.0, state.position[j], state.derivatives[0, j]
        advance(config.mujoco, state.mujoco, phase, none, q, dq)


@part
def _step_of_drives(config: PlantConfig, state: PlantState, torque: Array, t: float, dt: float, braked: bool) -> None:
    """As `step`, with elastic joints or friction that sticks; `torque` has what pushes the arm, shape (joints,)."""
    before = state.work[1]
    q, dq, gears = state.position, state.derivatives[0], state.drivetrain
    for j in range(q.size):
        gears.external[j], before[j] = torque[j] - state.effort[j], dq[j]
        gears.torque[j] = state.effort[j]
        if config.drivetrain.stiffness[j] == 0.0:
            gears.motor[j], gears.motor_velocity[j] = q[j], dq[j]
    if config.mujoco.steps > 0:
        phase, h = _phase(config, t), dt / config.mujoco.steps
        for k in range(config.mujoco.steps):
            advance_motors(config, state, phase, t + k * h, h, braked)
    else:
        loaded = config.payload_begin <= t < config.payload_end
        move(config.drivetrain, gears, config.loaded_model if loaded else config.model, q, dq, t, dt, braked)
    for j in range(q.size):
        state.derivatives[1, j] = (dq[j] - before[j]) / dt


@part
def stop_motors(config: PlantConfig, state: PlantState, t: float, dt: float) -> None:
    """Move the arm from t to t + dt (s) while brakes stop the motors of its elastic joints; pushes move its links."""
    for j in range(state.effort.size):
        state.effort[j] = 0.0
    torque = state.effort
    pushes = config.push_begin <= t < config.push_end
    if pushes or _is_pushed(state):
        _push(config, state, pushes, state.work[7])
        torque = state.work[7]
    _step_of_drives(config, state, torque, t, dt, True)


@inlined
def step(config: PlantConfig, state: PlantState, effort: Array, t: float, dt: float) -> None:
    """Integrate from t to t + dt (s) under the constant, limited `effort` by classical fourth-order Runge-Kutta.

    `effort` has shape (joints,), N m. Payload and push are those at the start of the step. With the engine MuJoCo, dt
    must be a period.
    """
    joints = effort.size
    loaded = config.payload_begin <= t < config.payload_end
    model = config.loaded_model if loaded else config.model
    q, dq, held = state.position, state.derivatives[0], state.effort
    work = state.work
    net, stage_q, stage_dq, pushed = work[0], work[1], work[2], work[7]
    k1, k2, k3, k4 = work[3], work[4], work[5], work[6]
    for j in range(joints):
        limit = config.effort_limit[j]
        held[j] = min(max(effort[j], -limit), limit)
    torque = held
    pushes = config.push_begin <= t < config.push_end
    if pushes or _is_pushed(state):
        _push(config, state, pushes, pushed)
        torque = pushed
    if config.drivetrain.substeps > 0:
        _step_of_drives(config, state, torque, t, dt, False)
        return
    if config.mujoco.steps > 0:
        _step_of_mujoco(config, state, t, dt, torque)
        return

    half = 0.5 * dt
    _acceleration(config, model, t, q, dq, torque, net, k1)
    for j in range(joints):
        stage_q[j] = q[j] + half * dq[j]
        stage_dq[j] = dq[j] + half * k1[j]
    _acceleration(config, model, t + half, stage_q, stage_dq, torque, net, k2)
    for j in range(joints):
        stage_q[j] = q[j] + half * (dq[j] + half * k1[j])
        stage_dq[j] = dq[j] + half * k2[j]
    _acceleration(config, model, t + half, stage_q, stage_dq, torque, net, k3)
    for j in range(joints):
        stage_q[j] = q[j] + dt * (dq[j] + half * k2[j])
        stage_dq[j] = dq[j] + dt * k3[j]
    _acceleration(config, model, t + dt, stage_q, stage_dq, torque, net, k4)
    for j in range(joints):
        # RK4 for q, with the velocities of its stages substituted.
        q[j] += dt * (dq[j] + dt * (k1[j] + k2[j] + k3[j]) / 6.0)
        dq[j] += dt * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]) / 6.0
    if config.accelerations:
        _acceleration(config, model, t + dt, q, dq, torque, net, state.derivatives[1])


@njit
def _step_now(address: int, effort: Array, t: float, dt: float) -> None:
    """`step` for Python; `address`: of `PlantMemory`."""
    memory = plant_at(address)
    step(memory.config, memory.state, effort, t, dt)


class Plant:
    """A simulated arm, built from checked parameters.

    Attributes:
        joints: number of joints.
        config, state: arguments of `step`.
        mujoco: the arm as MuJoCo simulates it; None: the other engine does.
    """

    def __init__(self, values: Mapping[str, Value], accelerations: bool = True) -> None:
        """Build the arm.

        Args:
            values: every parameter of `plant_schema`, as returned by `resolve`.
            accelerations: compute q'' at the samples, which takes a fifth of the time; otherwise it stays 0.

        Raises:
            ParameterError: the disturbance is for another number of joints, MuJoCo cannot simulate the arm, or see
                `check_friction`.
        """
        self.joints = len(find_robot(values).joints)
        disturbance = DISTURBANCES[str(values["disturbance.name"])]
        if disturbance.joints not in (0, self.joints):
            raise ParameterError(
                f"disturbance.name: {disturbance.name} requires {disturbance.joints} joints, not {self.joints}"
            )
        self._accelerations = accelerations
        self.mujoco: MujocoArm | None = None
        self._configure(values)
        check_friction(values, self._inertia(values), 1.0 / as_float(values["rate"]))
        self.state = PlantState(
            position=joint_array(values["initial_position"], self.joints),
            derivatives=np.zeros((2, self.joints)),
            effort=np.zeros(self.joints),
            work=np.zeros((8, self.joints)),
            wrench=np.zeros((2, 6)),
            placements=np.zeros((self.joints, 3, 4)),
            drivetrain=drivetrain_state(self.joints),
            mujoco=self.mujoco.state if self.mujoco else no_state(),
        )
        self.rest(self.state.position)
        self._memory = _LAYOUT.store(self.memory)

    @property
    def memory(self) -> PlantMemory:
        """What compiled code reads and changes."""
        return PlantMemory(self.config, self.state)

    @property
    def address(self) -> int:
        """Where compiled code finds `memory`."""
        return self._memory.address

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other parameters from the next step on; the state is kept."""
        self._configure(values)
        self._memory.write(self.memory)

    def _configure(self, values: Mapping[str, Value]) -> None:
        robot = find_robot(values)
        factors = {quantity: 1.0 + as_float(values[f"model_error.{quantity}"]) for quantity in QUANTITIES}
        model = robot.pack_model(values, factors=factors)
        friction = friction_config(values, self._inertia(values), 1.0 / as_float(values["rate"]))
        drives = drivetrain(values, robot, model)
        if values[ENGINE.name] == MUJOCO:
            viscous = np.zeros(self.joints) if drives.substeps else friction.viscous
            if self.mujoco:
                self.mujoco.set_parameters(values, factors, viscous, drives)
            else:
                self.mujoco = MujocoArm(values, factors, viscous, drives)
            friction = without_viscous(friction)
        picked_up, carried = as_float(values["payload.time"]), as_float(values["payload.duration"])
        pushed = as_float(values["push.time"])
        self.config = PlantConfig(
            model=make_model(robot, model),
            loaded_model=make_model(robot, robot.with_payload(model, payload_of(values))),
            payload_begin=picked_up,
            payload_end=sum_of_times(picked_up, carried) if carried else math.inf,
            disturbance=make_disturbance(DISTURBANCES[str(values["disturbance.name"])], values, self.joints),
            effort_limit=joint_array(values["limits.effort"], self.joints),
            push=joint_array(values["push.effort"], self.joints),
            wrench=wrench_of(robot, values),
            tool=NO_TOOL if robot.tool is None else robot.tool(model),
            push_begin=pushed,
            push_end=sum_of_times(pushed, as_float(values["push.duration"])),
            friction=friction,
            accelerations=self._accelerations,
            drivetrain=drives,
            mujoco=self.mujoco.config if self.mujoco else no_config(),
        )

    def _inertia(self, values: Mapping[str, Value]) -> Array:
        """See `Robot.joint_inertia`; at the start, for the model of the controller."""
        robot = find_robot(values)
        return robot.joint_inertia(robot.pack_model(values), joint_array(values["initial_position"], self.joints))

    def rest(self, position: Array) -> None:
        """Put the arm at rest at a position of its links, shape (joints,), rad; springs carry it."""
        self.state.position[:] = position
        self.state.derivatives[:] = self.state.effort[:] = 0.0
        rest_at(self.config.drivetrain, self.state.drivetrain, self.config.model, position)

    def reset(self) -> None:
        """Put everything but the arm back to its start."""
        if self.mujoco:
            self.mujoco.reset()

    def step(self, effort: Array, t: float, dt: float) -> None:
        """Hold `effort` (shape (joints,), N m, finite) from t to t + dt (s)."""
        _step_now(self.address, effort, t, dt)
