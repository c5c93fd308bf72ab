"""MuJoCo as the engine of the simulated arm: the rigid dynamics of `plant`, computed by MuJoCo.

Compiled code calls MuJoCo's own functions by their addresses, so that rollouts and nodes make the same call. Torques,
disturbances, dry friction, pushes and brakes are those of `plant`: before each step of MuJoCo they become the force on
the joints. MuJoCo adds rigid dynamics, viscous friction, joint limits and contacts.
"""

import ctypes
import math
import weakref
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import call_c
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters import Value
from pidtsm_core.robots.compiler import load_mujoco
from pidtsm_core.simulation.drivetrain import Drivetrain
from pidtsm_core.simulation.mujoco_model import SCENE, make_models, steps_of
from pidtsm_core.simulation.mujoco_payload import Phase

# As integers, for compiled code.
_CARRIED, _DROPPED = int(Phase.CARRIED), int(Phase.DROPPED)
_FASTEST = 1e6
"""Position or velocity (rad or rad/s) above which the simulation has diverged."""


class MujocoConfig(NamedTuple):
    """Parameters of a step of MuJoCo."""

    steps: int  # of MuJoCo in one period; 0: the other engine
    step: int  # address of mj_step
    forward: int  # address of mj_forward
    model: int  # address of the mjModel
    loaded_model: int  # the same with payload
    left_model: int  # the same after it is dropped
    positions: NDArray[np.int64]  # place of each joint in qpos, shape (joints,)
    velocities: NDArray[np.int64]  # place of each joint in qvel, shape (joints,)
    motor_positions: NDArray[np.int64]  # place of each elastic joint's motor in qpos; negative: it is rigid
    motor_velocities: NDArray[np.int64]  # its place in qvel
    payload: int  # body of the payload at the tool
    box: int  # place in qpos of the body that falls when the payload is dropped; negative: none
    box_velocity: int  # its place in qvel
    root: int  # body whose subtree has the velocities' point of reference
    owner: Array  # keeps the models alive, shape (0,)


class MujocoState(NamedTuple):
    """State of MuJoCo."""

    data: int  # address of the mjData
    qpos: Array  # of MuJoCo, shape (nq,)
    qvel: Array  # shape (nv,)
    qacc: Array  # shape (nv,)
    force: Array  # on the joints, qfrc_applied, shape (nv,)
    places: Array  # of the bodies, xpos, shape (nbody, 3)
    turns: Array  # of the bodies, xquat, shape (nbody, 4)
    axes: Array  # of the bodies, xmat, shape (nbody, 9)
    twists: Array  # of the bodies, angular and linear at the centre of their tree, cvel, shape (nbody, 6)
    centers: Array  # of mass of the subtrees, shape (nbody, 3)
    phase: NDArray[np.int64]  # of the payload in the last step, shape (1,), see `Phase`
    owner: Array  # keeps the mjData alive, shape (0,)


@inlined
def advance(config: MujocoConfig, state: MujocoState, phase: int, force: Array, q: Array, dq: Array) -> None:
    """One step of MuJoCo under a constant force on the joints, N m, shape (joints,); writes q and dq.

    `phase` is that of the payload. q becomes nan if the simulation diverges.
    """
    if not _place_joints(config, state, force, q, dq):
        return
    if phase == _DROPPED and state.phase[0] == _CARRIED and config.box >= 0:
        call_c(config.forward, (config.loaded_model, state.data))
        drop(config, state)
    state.phase[0] = phase
    call_c(config.step, (_model(config, phase), state.data))
    for j in range(q.size):
        q[j] = state.qpos[config.positions[j]]
        dq[j] = state.qvel[config.velocities[j]]


@inlined
def acceleration(
    config: MujocoConfig, state: MujocoState, phase: int, force: Array, q: Array, dq: Array, ddq: Array
) -> None:
    """Write q'' at q, q' under a force on the joints, see `advance`."""
    if not _place_joints(config, state, force, q, dq):
        return
    call_c(config.forward, (_model(config, phase), state.data))
    for j in range(q.size):
        ddq[j] = state.qacc[config.velocities[j]]


@inlined
def _model(config: MujocoConfig, phase: int) -> int:
    """Address of the model in a phase."""
    if phase == _CARRIED:
        return config.loaded_model
    return config.left_model if phase == _DROPPED else config.model


@inlined
def drop(config: MujocoConfig, state: MujocoState) -> None:
    """Put the box that falls where the payload is, with its velocity; places and velocities are up to date."""
    i, a, b = config.payload, config.box, config.box_velocity
    axes, twist = state.axes[i], state.twists[i]
    to0, to1, to2 = (
        state.places[i, 0] - state.centers[config.root, 0],
        state.places[i, 1] - state.centers[config.root, 1],
        state.places[i, 2] - state.centers[config.root, 2],
    )
    state.qvel[b] = twist[3] + twist[1] * to2 - twist[2] * to1
    state.qvel[b + 1] = twist[4] + twist[2] * to0 - twist[0] * to2
    state.qvel[b + 2] = twist[5] + twist[0] * to1 - twist[1] * to0
    for k in range(3):
        state.qpos[a + k] = state.places[i, k]
        # Angular velocities of a free body are in its own axes.
        state.qvel[b + 3 + k] = axes[k] * twist[0] + axes[3 + k] * twist[1] + axes[6 + k] * twist[2]
    for k in range(4):
        state.qpos[a + 3 + k] = state.turns[i, k]


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
    return MujocoConfig(0, 0, 0, 0, 0, 0, places, places, places, places, 0, -1, 0, 0, np.zeros(0))


def no_state() -> MujocoState:
    """The state of a plant with the other engine."""
    none, table = np.zeros(0), np.zeros((0, 0))
    return MujocoState(0, none, none, none, none, table, table, table, table, table, np.zeros(1, dtype=np.int64), none)


class MujocoArm:
    """An arm that MuJoCo simulates.

    Attributes:
        models: the models, and what belongs to the arm.
        data: of type ``mujoco.MjData``.
        config, state: arguments of `advance`.
    """

    def __init__(
        self,
        values: Mapping[str, Value],
        factors: Mapping[str, float],
        viscous: Array,
        drives: Drivetrain | None = None,
        shown: bool = False,
    ) -> None:
        """Compile the models.

        For arguments and `ParameterError`, see `make_models`.
        """
        self._built: tuple[object, ...] = ()
        self._shown = shown
        self.set_parameters(values, factors, viscous, drives)
        self.data = data = load_mujoco().MjData(self.models.empty)
        self.state = MujocoState(
            data._address,
            data.qpos,
            data.qvel,
            data.qacc,
            data.qfrc_applied,
            data.xpos,
            data.xquat,
            data.xmat,
            data.cvel,
            data.subtree_com,
            np.zeros(1, dtype=np.int64),
            _owner(data),
        )

    def set_parameters(
        self, values: Mapping[str, Value], factors: Mapping[str, float], viscous: Array, drives: Drivetrain | None
    ) -> None:
        """Use other parameters from the next step on; the state is kept.

        For arguments and `ParameterError`, see `__init__`.
        """
        chosen, steps = {name: values[name] for name in values if _concerns(name)}, steps_of(values, drives)
        built = (chosen, tuple(factors.items()), viscous.tobytes(), steps)
        if built == self._built:
            return
        self._built = built
        self.models = models = make_models(values, factors, viscous, drives, self._shown)
        step, forward = _addresses()
        joints, model = list(models.joints), models.empty
        box = int(model.body_jntadr[models.dropped]) if models.dropped else -1
        self.config = MujocoConfig(
            steps=steps,
            step=step,
            forward=forward,
            model=model._address,
            loaded_model=models.loaded._address,
            left_model=models.left._address,
            positions=model.jnt_qposadr[joints].astype(np.int64),
            velocities=model.jnt_dofadr[joints].astype(np.int64),
            motor_positions=_places(model.jnt_qposadr, models.motors),
            motor_velocities=_places(model.jnt_dofadr, models.motors),
            payload=models.payload,
            box=int(model.jnt_qposadr[box]) if models.dropped else -1,
            box_velocity=int(model.jnt_dofadr[box]) if models.dropped else 0,
            root=int(model.body_rootid[models.payload]),
            owner=_owner(models),
        )

    def reset(self) -> None:
        """Put everything but the arm back to where it is in the description."""
        load_mujoco().mj_resetData(self.models.empty, self.data)
        self.state.phase[0] = Phase.ABSENT


def _places(addresses: NDArray[np.int32], joints: tuple[int, ...]) -> NDArray[np.int64]:
    """The addresses of joints of MuJoCo, shape (joints,); that of a negative index is negative."""
    return np.array([addresses[joint] if joint >= 0 else -1 for joint in joints], dtype=np.int64)


def _concerns(name: str) -> bool:
    """Whether a parameter with this name is part of the models."""
    when = ("payload.time", "payload.duration")
    return (name.startswith(("robot.", "payload.", "elasticity.")) and name not in when) or name in (
        "joints",
        SCENE.name,
    )


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
