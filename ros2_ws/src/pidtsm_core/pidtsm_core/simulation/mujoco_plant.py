"""MuJoCo as the engine of the simulated arm: the rigid dynamics of `plant`, computed by MuJoCo.

Compiled code calls MuJoCo's own functions by their addresses, so that rollouts and nodes make the same call. Torques,
disturbances, dry friction, pushes and brakes are those of `plant`: before each step of MuJoCo they become the force on
the joints. MuJoCo adds rigid dynamics, viscous friction, joint limits and contacts.
"""

import ctypes
import math
import weakref
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiled import inlined
from pidtsm_core.parameters import Array, Parameter, ParameterError, Value, as_float
from pidtsm_core.robots import DESCRIPTION, DescriptionError, Robot, TreeRobot, find_robot, payload_of
from pidtsm_core.robots.address import call
from pidtsm_core.robots.compiler import compile_spec, load_mujoco
from pidtsm_core.robots.rigid_bodies import PAYLOAD, described_bodies, set_inertial, text_bodies
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.timing import period_nanoseconds, seconds

MUJOCO = "mujoco"
ENGINE = Parameter(
    "engine",
    "rigid_body",
    "what computes the motion of the arm; rigid_body: the equations of the robot model, by Runge-Kutta; mujoco: "
    "MuJoCo, from the same description",
    choices=("rigid_body", MUJOCO),
    read_only=True,
)
_INTEGRATOR = Parameter(
    "mujoco.integrator",
    "rk4",
    "integrator of MuJoCo",
    choices=("euler", "implicit", "implicitfast", "rk4"),
    read_only=True,
)
_TIMESTEP = Parameter(
    "mujoco.timestep",
    0.001,
    "largest step of MuJoCo: a period is divided into equal steps that are not longer",
    "s",
    minimum=1e-6,
    read_only=True,
)
_PARAMETERS = (_INTEGRATOR, _TIMESTEP)
"""Those that only this engine has."""

_FASTEST = 1e6
"""Position or velocity (rad or rad/s) above which the simulation has diverged."""


class MujocoConfig(NamedTuple):
    """Parameters of a step of MuJoCo."""

    steps: int  # of MuJoCo in one period; 0: the other engine
    step: int  # address of mj_step
    forward: int  # address of mj_forward
    model: int  # address of the mjModel
    loaded_model: int  # the same with payload
    positions: NDArray[np.int64]  # place of each joint in qpos, shape (joints,)
    velocities: NDArray[np.int64]  # place of each joint in qvel, shape (joints,)
    owner: Array  # keeps both models alive, shape (0,)


class MujocoState(NamedTuple):
    """State of MuJoCo."""

    data: int  # address of the mjData
    qpos: Array  # of MuJoCo, shape (nq,)
    qvel: Array  # shape (nv,)
    qacc: Array  # shape (nv,)
    force: Array  # on the joints, qfrc_applied, shape (nv,)
    owner: Array  # keeps the mjData alive, shape (0,)


def engine_schema(settings: Mapping[str, object], of_robot: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    """The parameters of the simulated arm, `of_robot`, with the choice of the engine and what depends on it.

    Raises:
        ParameterError: there is no such engine.
    """
    if ENGINE.check(settings.get(ENGINE.name, ENGINE.default), 1) != MUJOCO:
        return (*of_robot, ENGINE)
    rigid = {f"robot.{name}": value for name, value in find_robot(settings).rigid.items()}
    chosen = (replace(p, default=rigid[p.name], choices=(rigid[p.name],)) if p.name in rigid else p for p in of_robot)
    return (*chosen, ENGINE, *_PARAMETERS)


@inlined
def advance(config: MujocoConfig, state: MujocoState, loaded: bool, force: Array, q: Array, dq: Array) -> None:
    """One step of MuJoCo under a constant force on the joints, N m, shape (joints,); writes q and dq.

    q becomes nan if the simulation diverges.
    """
    if not _place_joints(config, state, force, q, dq):
        return
    call(config.step, (config.loaded_model if loaded else config.model, state.data))
    for j in range(q.size):
        q[j] = state.qpos[config.positions[j]]
        dq[j] = state.qvel[config.velocities[j]]


@inlined
def acceleration(
    config: MujocoConfig, state: MujocoState, loaded: bool, force: Array, q: Array, dq: Array, ddq: Array
) -> None:
    """Write q'' at q, q' under a force on the joints, see `advance`."""
    if not _place_joints(config, state, force, q, dq):
        return
    call(config.forward, (config.loaded_model if loaded else config.model, state.data))
    for j in range(q.size):
        ddq[j] = state.qacc[config.velocities[j]]


@inlined
def _place_joints(config: MujocoConfig, state: MujocoState, force: Array, q: Array, dq: Array) -> bool:
    """Hand positions, velocities and forces to MuJoCo, unless they have diverged."""
    for j in range(q.size):
        if not (abs(q[j]) < _FASTEST and abs(dq[j]) < _FASTEST and math.isfinite(force[j])):
            q[0] = math.nan
            return False
        state.qpos[config.positions[j]] = q[j]
        state.qvel[config.velocities[j]] = dq[j]
        state.force[config.velocities[j]] = force[j]
    return True


def no_config() -> MujocoConfig:
    """The parameters of a plant with the other engine."""
    places = np.zeros(0, dtype=np.int64)
    return MujocoConfig(0, 0, 0, 0, 0, places, places, np.zeros(0))


def no_state() -> MujocoState:
    """The state of a plant with the other engine."""
    return MujocoState(0, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))


class MujocoArm:
    """An arm that MuJoCo simulates.

    Attributes:
        model, loaded_model: of type ``mujoco.MjModel``, without and with payload; both have the same structure.
        data: of type ``mujoco.MjData``.
        config, state: arguments of `advance`.
    """

    def __init__(self, values: Mapping[str, Value], factors: Mapping[str, float], viscous: Array) -> None:
        """Compile the models.

        Args:
            values: every parameter of `plant_schema`, as returned by `resolve`.
            factors: model errors by quantity, see `Robot.pack_model`.
            viscous: friction that MuJoCo integrates together with the motion, shape (joints,), N m s/rad.

        Raises:
            ParameterError: MuJoCo cannot simulate this arm.
        """
        self._built: tuple[object, ...] = ()
        self.set_parameters(values, factors, viscous)
        self.data = data = load_mujoco().MjData(self.model)
        self.state = MujocoState(data._address, data.qpos, data.qvel, data.qacc, data.qfrc_applied, _owner(data))

    def set_parameters(self, values: Mapping[str, Value], factors: Mapping[str, float], viscous: Array) -> None:
        """Use other parameters from the next step on; the state is kept.

        For arguments and `ParameterError`, see `__init__`.
        """
        robot, payload = find_robot(values), payload_of(values)
        packed = robot.pack_model(values, factors=factors)
        built = (payload.mass, *(a.tobytes() for a in (packed, payload.center_of_mass, payload.inertia, viscous)))
        if built == self._built:
            return
        self._built = built
        try:
            spec = _bodies(robot, packed, factors)
            self.model = _compiled(spec, values)
            set_inertial(spec.body(PAYLOAD), *payload)
            self.loaded_model = _compiled(spec, values)
        except DescriptionError as error:
            raise ParameterError(f"{DESCRIPTION.name}: {error}", DESCRIPTION.name) from None
        joints = [self.model.joint(name) for name in robot.joints]
        for model in (self.model, self.loaded_model):
            _set_joints(model, [int(joint.dofadr[0]) for joint in joints], viscous, _armature(robot, packed))
        step, forward = _addresses()
        self.config = MujocoConfig(
            steps=_steps(values),
            step=step,
            forward=forward,
            model=self.model._address,
            loaded_model=self.loaded_model._address,
            positions=np.array([joint.qposadr[0] for joint in joints], dtype=np.int64),
            velocities=np.array([joint.dofadr[0] for joint in joints], dtype=np.int64),
            owner=_owner((self.model, self.loaded_model)),
        )

    def reset(self) -> None:
        """Put everything but the arm back to where it is in the description."""
        load_mujoco().mj_resetData(self.model, self.data)


def _bodies(robot: Robot, packed: Array, factors: Mapping[str, float]) -> Any:
    """The bodies of a robot with model errors, of type ``mujoco.MjSpec``, with an empty payload."""
    if isinstance(robot, TreeRobot):
        changed = factors["mass"] != 1.0 or factors["inertia"] != 1.0
        return described_bodies(robot.description, factors["length"], packed if changed else None)
    if robot.mjcf is None:
        raise DescriptionError(f"{robot.name} is a closed form without an MJCF, so MuJoCo cannot simulate it")
    return text_bodies(robot.mjcf(packed))


def _compiled(spec: Any, values: Mapping[str, Value]) -> Any:
    """The model of the bodies, of type ``mujoco.MjModel``.

    Raises:
        DescriptionError: see `compile_spec`.
    """
    mujoco = load_mujoco()
    model = compile_spec(spec)
    model.opt.timestep = seconds(_period(values)) / _steps(values)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{str(values[_INTEGRATOR.name]).upper()}")
    # A value that is not finite ends a rollout; MuJoCo would start again.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return model


def _set_joints(model: Any, dofs: list[int], viscous: Array, armature: Array | None) -> None:
    """Set what the parameters say of the joints, whose places in qvel are `dofs`; dry friction is that of `plant`."""
    model.dof_damping[dofs] = viscous
    model.dof_frictionloss[dofs] = 0.0
    if armature is not None:
        model.dof_armature[dofs] = armature
    mujoco = load_mujoco()
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _armature(robot: Robot, packed: Array) -> Array | None:
    """Inertia of the rotors of an arm of data, in the order of its joints, shape (joints,), kg m^2."""
    if not isinstance(robot, TreeRobot):
        return None
    table = rows(packed)
    return np.asarray(table[np.argsort(table[:, Column.PLACE]), Column.ARMATURE])


def _period(values: Mapping[str, Value]) -> int:
    return period_nanoseconds(int(as_float(values["rate"])))


def _steps(values: Mapping[str, Value]) -> int:
    """Steps of MuJoCo in one period."""
    # Less a rounding error, so that a period of 1 ms is one step of 1 ms.
    return math.ceil(seconds(_period(values)) / as_float(values[_TIMESTEP.name]) * (1.0 - 1e-9))


_Warning = ctypes.CFUNCTYPE(None, ctypes.c_char_p)


@_Warning
def _ignore(_message: bytes) -> None:
    """MuJoCo would write its warnings to a file in the working folder; what they mean is seen from the state."""


@cache
def _addresses() -> tuple[int, int]:
    """Addresses of mj_step and mj_forward."""
    folder = Path(load_mujoco().__file__).parent
    library = ctypes.CDLL(str(next(folder.glob("libmujoco*"))))
    ctypes.c_void_p.in_dll(library, "mju_user_warning").value = ctypes.cast(_ignore, ctypes.c_void_p).value
    step, forward = (ctypes.cast(f, ctypes.c_void_p).value for f in (library.mj_step, library.mj_forward))
    assert step is not None
    assert forward is not None
    return step, forward


def _owner(owned: object) -> Array:
    """An array that keeps an object alive for as long as the array exists: compiled code takes arrays only."""
    owner = np.zeros(0)
    weakref.finalize(owner, _release, owned)
    return owner


def _release(_owned: object) -> None:
    """The object is not needed any more."""
