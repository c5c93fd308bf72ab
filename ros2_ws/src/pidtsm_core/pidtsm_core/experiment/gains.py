"""A first set of gains for an arm, from its inertias and the quality of its sensors: `first_gains`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import LAW_NAME
from pidtsm_core.experiment.law_gains import Gain, Known, gains_of_law, rounded
from pidtsm_core.experiment.loop_margin import Drives, bandwidths
from pidtsm_core.parameters import Parameter, Value, joint_array, resolve
from pidtsm_core.robots import Robot, find_robot, payload_of, payload_schema, robot_joints, robot_schema

BITS, DELAY, RATE = 14, 0.001, 1000.0
"""Steps of the encoders (2^BITS per revolution, or per metre), s, Hz: hardware that the gains suit by default."""

_NOISE = 0.06
"""Mean change of the torque from sample to sample, relative to H w^2 step: measured with all arms of the project."""
_BOUNDS = ("the noise of the torque", "the delay", "the elasticity of arms", "the margins of the loop")
_ROUGHNESS, _ROUGH = 0.002, 0.2
"""Tolerated change, as a share of the effort limit, and at most; N m (or N)."""
_PHASE = 0.6
"""Largest product of bandwidth and delay, rad; with all arms, and a model 20 % off, the loop oscillates from 0.9 on."""
_ELASTIC = 60.0
"""Largest bandwidth, rad/s: about 10 Hz, where the gears and links of many arms begin to resonate."""
_POSTURES = 2
"""Beside the middle of the range, in which the margins of a loop are judged."""
_AS_FAST = 0.9
"""Share of the bandwidth of one for a rigid arm, in the geometric mean of the joints, that an observer which knows the
springs must have to be chosen."""
_WAITING = 1.5
"""Periods that pass between a measurement and the mean effect of its command."""


def first_gains(
    settings: Mapping[str, object],
    bits: int = BITS,
    delay: float = DELAY,
    rate: float = RATE,
    law: str = str(LAW_NAME.default),
    drives: Drives | None = None,
) -> tuple[Gain, ...]:
    """Gains of a law with the extended state observer, for an arm with these sensors.

    Because of the steps of its encoder, joint k makes the torque of joint j change by 0.06 |H_jk| w_k^2 step_k from
    sample to sample, where w_k is the bandwidth of its observer. So the more inertia a joint moves, the lower is its
    bandwidth, unless the delay or the elasticity of a real arm limits it first.

    Args:
        settings: parameters of the controller that differ from their defaults; those of robot and payload matter.
        bits: resolution of the encoders, 2^bits steps per revolution, or per metre of a sliding joint; 0: ideal.
        delay: from a position to its joint state, plus from a command to its torque, s.
        rate: joint states per second.
        law: name of the law.
        drives: with them, the loop also keeps its margins in spite of the elasticity of the joints, see `loop_margin`;
            if they are `observed`, the observer knows the springs, unless it must be slower then.

    Raises:
        UsageError: there is no rule for the law, or (`ParameterError`) the arm cannot be used, see `find_robot`.
    """
    robot = find_robot(settings)
    span = np.where(robot.slides or [False] * len(robot.joints), 1.0, 2.0 * math.pi)
    steps = span / 2.0**bits if bits else np.zeros_like(span)
    values = _checked(settings)
    inertia = np.abs(_inertia(robot, values))
    limits = joint_array(values["limits.effort"], len(robot.joints))
    lateness = delay + _WAITING / rate
    bandwidth, bounds = rigid = _bandwidths(inertia, limits, steps, lateness, True)
    if drives is not None:
        aware = _bandwidths(inertia, limits, steps, lateness, False)
        drives, bandwidth, bounds = _of_loop(drives, _inertias(robot, values), rigid, aware)
    known = Known(bandwidth=bandwidth, steps=steps, inertia=np.diag(inertia))
    return (
        Gain("law.name", law, "the proposed law" if law == LAW_NAME.default else "the chosen law"),
        *_observer(drives),
        Gain(
            "estimator.bandwidth",
            rounded(bandwidth),
            f"the faster, the better; limited by {_grouped(robot.joints, bounds)}",
        ),
        *gains_of_law(law, known),
        Gain(
            "law.anti_windup",
            "conditional",
            "integrals and adaptation pause at the limits of the torque, and in contact",
        ),
    )


def _observer(drives: Drives | None) -> tuple[Gain, ...]:
    """The observer, and what it knows of the drives."""
    if drives is None or not drives.observed:
        return (
            Gain("estimator.name", "extended_state_observer", "it differentiates without the noise of differences"),
        )
    late = Gain("drive.delay", drives.ahead * drives.period, "delay and lag of the drives, and half a period")
    return (
        Gain("estimator.name", "elastic_joint_observer", "it knows that the joints are elastic"),
        Gain("estimator.stiffness", tuple(drives.stiffness.tolist()), "that of the gears"),
        Gain("estimator.damping", tuple(drives.damping.tolist()), "likewise"),
        Gain("estimator.rate", 1.0 / drives.period, "joint states per second"),
        Gain("estimator.at_links", not drives.on_motor, "where the encoders are"),
        *((late,) if drives.ahead else ()),
    )


def rotors(settings: Mapping[str, object]) -> Array:
    """Inertias of the rotors that the controller knows, as the joints see them, shape (joints,), kg m^2; 0: none."""
    robot = find_robot(settings)
    return robot.rotors(robot.pack_model(_checked(settings)))


def _of_loop(
    drives: Drives, inertias: list[Array], rigid: tuple[Array, list[str]], aware: tuple[Array, list[str]]
) -> tuple[Drives, Array, list[str]]:
    """The drives, bandwidths with which the loop keeps its margins, rad/s, and what limits each of them.

    Args:
        drives: if they are `observed`, the observer knows the springs, unless it must be slower then.
        inertias: see `bandwidths`.
        rigid: bandwidths without margins, shape (joints,), rad/s, and what limits them, of an observer that takes the
            arm for rigid.
        aware: likewise, of one that knows the springs.
    """
    unaware = replace(drives, observed=False)
    kept = bandwidths(unaware, inertias, rigid[0])
    if drives.observed:
        faster = bandwidths(drives, inertias, aware[0])
        # Where rotors are heavy and springs soft, feedback from the motors damps better.
        if np.mean(np.log(faster / kept)) >= np.log(_AS_FAST):
            return drives, faster, _limited(faster, *aware)
    return unaware, kept, _limited(kept, *rigid)


def _limited(kept: Array, fastest: Array, bounds: list[str]) -> list[str]:
    """What limits each of the bandwidths that were kept, given the fastest ones and their bounds."""
    return [_BOUNDS[-1] if low < high else its for low, high, its in zip(kept, fastest, bounds, strict=True)]


def _bandwidths(inertia: Array, limits: Array, steps: Array, delay: float, resonates: bool) -> tuple[Array, list[str]]:
    """Bandwidths of the observers, shape (joints,), rad/s, and what limits each of them.

    If the arm may be elastic without the observer's knowledge, it `resonates`.
    """
    rough = np.minimum(_ROUGHNESS * limits, _ROUGH)
    with np.errstate(divide="ignore"):
        of_noise = np.sqrt((rough[:, np.newaxis] / inertia).min(axis=0) / (_NOISE * steps))
    of_delay = np.full_like(of_noise, _PHASE / delay)
    candidates = np.array([of_noise, of_delay, np.full_like(of_noise, _ELASTIC if resonates else np.inf)])
    return candidates.min(axis=0), [_BOUNDS[i] for i in candidates.argmin(axis=0)]


def _grouped(joints: Sequence[str], bounds: Sequence[str]) -> str:
    """The bounds that apply, each with its joints."""
    used = {bound: [joint for joint, its in zip(joints, bounds, strict=True) if its == bound] for bound in _BOUNDS}
    return " and by ".join(f"{bound} ({', '.join(names)})" for bound, names in used.items() if names)


def _schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """The parameters of the robot, and of the payload that the controller knows."""
    robot = find_robot(settings)
    return (
        *robot_schema(settings, robot),
        *payload_schema(settings, "mass of the payload that the controller knows", robot),
    )


def _checked(settings: Mapping[str, object]) -> Mapping[str, Value]:
    """Every parameter of `_schema`."""
    known = {p.name for p in _schema(settings)}
    return resolve(_schema, {n: v for n, v in settings.items() if n in known}, robot_joints(settings))


def _inertia(robot: Robot, values: Mapping[str, Value], q: Array | None = None) -> Array:
    """The inertia matrix with payload at q (None: in the middle of the range), shape (joints, joints), kg m^2."""
    loaded = robot.with_payload(robot.pack_model(values), payload_of(values))
    return robot.inertia_matrix(loaded, np.array(robot.initial_position) if q is None else q)


def _inertias(robot: Robot, values: Mapping[str, Value]) -> list[Array]:
    """Inertia matrices in the middle of the range, and in postures spread over it."""
    middle = np.array(robot.initial_position)
    limits = robot.position_limits or [(q - math.pi, q + math.pi) for q in middle]
    lower, upper = np.array(limits).T
    spread = np.random.default_rng(0).uniform(lower, upper, size=(_POSTURES, middle.size))
    return [_inertia(robot, values, q) for q in (middle, *spread)]
