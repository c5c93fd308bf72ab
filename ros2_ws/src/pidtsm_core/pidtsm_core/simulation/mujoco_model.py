"""The model that MuJoCo simulates: the arm, alone or in a scene, and the parameters of the engine."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float
from pidtsm_core.robots import DESCRIPTION, DescriptionError, Robot, TreeRobot, find_robot, payload_of
from pidtsm_core.robots.compiler import compile_spec, load_mujoco, load_spec
from pidtsm_core.robots.rigid_bodies import (
    PAYLOAD,
    add_skeleton,
    add_surroundings,
    described_bodies,
    set_inertial,
    text_bodies,
)
from pidtsm_core.simulation.drivetrain import Drivetrain
from pidtsm_core.simulation.mujoco_motors import add_motors, motor_name, steps_for
from pidtsm_core.simulation.mujoco_payload import DROPPED, Phase, add_boxes, release_box, show_box
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
SCENE = Parameter(
    "scene",
    "",
    "what surrounds the arm: the path of an MJCF file; the arm stands on its site named robot, or else in the origin; "
    "empty: nothing",
    read_only=True,
)
_PARAMETERS = (_INTEGRATOR, _TIMESTEP, SCENE)
"""Those that only this engine has."""
_PLACE = "robot"
"""Name of the site of a scene on which the arm stands."""
_OF_ARM = "robot/"
"""What precedes the names of the arm's bodies and joints in a scene."""


class MujocoModels(NamedTuple):
    """The arm as MuJoCo simulates it; all models have the same structure."""

    empty: Any  # of type mujoco.MjModel, before the payload is picked up
    loaded: Any  # with payload
    left: Any  # after it is dropped
    joints: tuple[int, ...]  # index of each joint
    bodies: Mapping[int, str]  # names of the arm's bodies by their index; that of the tool also for its payload
    payload: int  # index of the body of the payload at the tool
    motors: tuple[int, ...]  # index of the joint of each elastic joint's motor; negative: the joint is rigid
    dropped: int  # index of the body that falls when the payload is dropped; 0: it just vanishes


def engine_schema(
    settings: Mapping[str, object], robot: Robot, of_robot: tuple[Parameter, ...]
) -> tuple[Parameter, ...]:
    """The parameters of the simulated arm, `of_robot`, with the choice of the engine and what depends on it.

    Raises:
        ParameterError: there is no such engine.
    """
    if ENGINE.check(settings.get(ENGINE.name, ENGINE.default), 1) != MUJOCO:
        return (*of_robot, ENGINE)
    rigid = {f"robot.{name}": value for name, value in robot.rigid.items()}
    chosen = (replace(p, default=rigid[p.name], choices=(rigid[p.name],)) if p.name in rigid else p for p in of_robot)
    return (*chosen, ENGINE, *_PARAMETERS)


def with_engine(values: Mapping[str, Value]) -> dict[str, Value]:
    """Parameters of a simulator, with those of MuJoCo if they are of one with the other engine."""
    return {**{p.name: p.default for p in _PARAMETERS}, **values}


def make_models(
    values: Mapping[str, Value],
    factors: Mapping[str, float],
    viscous: Array,
    drives: Drivetrain | None = None,
    shown: bool = False,
) -> MujocoModels:
    """Compile the arm in its scene.

    Args:
        values: every parameter of `plant_schema`, as returned by `resolve`.
        factors: model errors by quantity, see `Robot.pack_model`.
        viscous: friction that MuJoCo integrates together with the motion, shape (joints,), N m s/rad.
        drives: the drive trains; None: all joints are rigid.
        shown: for pictures: also an arm without a scene has its shapes, and one without shapes a skeleton.

    Raises:
        ParameterError: MuJoCo cannot simulate the arm, or the scene cannot be read.
    """
    robot, scene = find_robot(values), str(values[SCENE.name])
    packed = robot.pack_model(values, factors=factors)
    arm = _arm(robot, packed, factors, touches=bool(scene), shown=shown)
    prefix = of_arm(scene)
    try:
        spec = _placed(scene, arm, payload_of(values)) if scene else arm
        if shown:
            add_surroundings(spec)
        if drives:
            add_motors(spec, [prefix + name for name in robot.joints], drives)
        empty, loaded, left = (_compiled(spec, values, phase, drives) for phase in Phase)
    except DescriptionError as error:
        raise ParameterError(f"{SCENE.name}: {scene}: {error}", SCENE.name) from None
    joints = [empty.joint(prefix + name) for name in robot.joints]
    for model in (empty, loaded, left):
        _set_joints(model, [int(joint.dofadr[0]) for joint in joints], viscous, _armature(robot, packed, drives))
    return MujocoModels(
        empty,
        loaded,
        left,
        tuple(joint.id for joint in joints),
        _bodies_of_arm(empty, prefix),
        empty.body(prefix + PAYLOAD).id,
        _motors(empty, robot, drives),
        empty.body(DROPPED).id if scene else 0,
    )


def shapes_in_scene(values: Mapping[str, Value]) -> Any:
    """The arm with its shapes, alone or in its scene, of type ``mujoco.MjSpec``.

    Args:
        values: every parameter of `plant_schema`, as returned by `resolve`.

    Raises:
        ParameterError: see `make_models`; also, the arm has no shapes.
    """
    robot, scene, factors = find_robot(values), str(values[SCENE.name]), {"length": 1.0, "mass": 1.0, "inertia": 1.0}
    arm = _arm(robot, robot.pack_model(values), factors, touches=True, shown=False)
    try:
        return _placed(scene, arm, payload_of(values)) if scene else arm
    except DescriptionError as error:
        raise ParameterError(f"{SCENE.name}: {scene}: {error}", SCENE.name) from None


def of_arm(scene: str) -> str:
    """What precedes the names of the arm's bodies and joints in a scene; in an empty one, nothing."""
    return _OF_ARM if scene else ""


def _arm(robot: Robot, packed: Array, factors: Mapping[str, float], touches: bool, shown: bool) -> Any:
    """The arm alone, of type ``mujoco.MjSpec``.

    Raises:
        ParameterError: MuJoCo cannot simulate it, or it shall touch something and has no shapes.
    """
    try:
        arm = _bodies(robot, packed, factors, touchable=touches or shown)
        if shown:
            add_skeleton(arm)
        elif touches:
            _check_shapes(arm)
        compile_spec(arm)  # An error of the arm is not one of the scene.
    except DescriptionError as error:
        raise ParameterError(f"{DESCRIPTION.name}: {error}", DESCRIPTION.name) from None
    return arm


def _check_shapes(arm: Any) -> None:
    """Check that an arm can touch a scene.

    Raises:
        DescriptionError: it has no shape.
    """
    if not arm.geoms:
        raise DescriptionError("no link has a shape that MuJoCo can read, so the arm cannot touch a scene")


def _placed(scene: str, arm: Any, payload: tuple[float, Array, Array]) -> Any:
    """The scene with the arm and its payload, of type ``mujoco.MjSpec``; gravity is that of the arm.

    Raises:
        DescriptionError: the scene cannot be read.
    """
    spec = load_spec(Path(scene))
    spec.option.gravity = arm.option.gravity
    site = spec.site(_PLACE)
    where = {"frame": spec.worldbody.add_frame()} if site is None else {"site": site}
    spec.attach(arm, prefix=_OF_ARM, **where)
    add_boxes(spec, _OF_ARM + PAYLOAD, [body.name for body in spec.bodies if body.name.startswith(_OF_ARM)], payload)
    return spec


def _bodies_of_arm(model: Any, prefix: str) -> dict[int, str]:
    """See `MujocoModels.bodies`."""
    names = {body: model.body(body).name for body in range(1, model.nbody)}
    found = {body: name.removeprefix(prefix) for body, name in names.items() if name.startswith(prefix)}
    payload = model.body(prefix + PAYLOAD)
    found[payload.id] = found[int(payload.parentid[0])]
    return found


def _bodies(robot: Robot, packed: Array, factors: Mapping[str, float], touchable: bool) -> Any:
    """The bodies of a robot with model errors, of type ``mujoco.MjSpec``, with an empty payload.

    Raises:
        DescriptionError: MuJoCo cannot simulate the robot.
    """
    if isinstance(robot, TreeRobot):
        changed = factors["mass"] != 1.0 or factors["inertia"] != 1.0
        return described_bodies(robot.description, factors["length"], packed if changed else None, touchable)
    if robot.mjcf is None:
        raise DescriptionError(f"{robot.name} is a closed form without an MJCF, so MuJoCo cannot simulate it")
    return text_bodies(robot.mjcf(packed))


def _motors(model: Any, robot: Robot, drives: Drivetrain | None) -> tuple[int, ...]:
    """See `MujocoModels.motors`."""
    elastic = np.zeros(len(robot.joints)) if drives is None else drives.stiffness
    return tuple(model.joint(motor_name(j)).id if stiffness else -1 for j, stiffness in enumerate(elastic))


def _compiled(spec: Any, values: Mapping[str, Value], phase: Phase, drives: Drivetrain | None) -> Any:
    """The model of the bodies in a phase, of type ``mujoco.MjModel``.

    Raises:
        DescriptionError: see `compile_spec`.
    """
    mujoco, scene = load_mujoco(), bool(values[SCENE.name])
    tool = next(body for body in spec.bodies if body.name.endswith(PAYLOAD))
    set_inertial(tool, *(payload_of(values) if phase == Phase.CARRIED else (0.0, np.zeros(3), np.zeros((3, 3)))))
    if scene:
        show_box(spec, tool.name, phase)
    model = compile_spec(spec)
    if scene:
        release_box(model, phase)
    model.opt.timestep = seconds(_period(values)) / steps_of(values, drives)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{str(values[_INTEGRATOR.name]).upper()}")
    # A value that is not finite ends a rollout; MuJoCo would start again.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return model


def _set_joints(model: Any, dofs: list[int], viscous: Array, armature: Array | None) -> None:
    """Apply the parameters of the joints, whose places in qvel are `dofs`; dry friction is that of `plant`."""
    model.dof_damping[dofs] = viscous
    model.dof_frictionloss[dofs] = 0.0
    if armature is not None:
        model.dof_armature[dofs] = armature
    mujoco = load_mujoco()
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _armature(robot: Robot, packed: Array, drives: Drivetrain | None) -> Array | None:
    """Inertia of the rotors that move with their links, shape (joints,), kg m^2; None: that of the bodies' text."""
    if drives is None or not drives.elastic:
        return robot.rotors(packed) if isinstance(robot, TreeRobot) else None
    return robot.rotors(packed) - drives.rotor


def _period(values: Mapping[str, Value]) -> int:
    return period_nanoseconds(int(as_float(values["rate"])))


def steps_of(values: Mapping[str, Value], drives: Drivetrain | None) -> int:
    """Steps of MuJoCo in one period.

    Raises:
        ParameterError: the drive trains need too many.
    """
    # Less a rounding error, so that a period of 1 ms is one step of 1 ms.
    period = seconds(_period(values))
    steps = math.ceil(period / as_float(values[_TIMESTEP.name]) * (1.0 - 1e-9))
    return steps if drives is None else max(steps, steps_for(drives, period))
