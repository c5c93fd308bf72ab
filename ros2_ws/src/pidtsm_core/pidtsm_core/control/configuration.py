"""The controller's configuration: its parameters in the form that a step reads, grouped as the parameters are."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control.compliance_parameters import SPACE, ComplianceConfig, make_compliance
from pidtsm_core.control.friction_parameters import BREAKAWAY
from pidtsm_core.control.parameters import (
    ADAPTATION,
    LEARNT_FRICTION,
    LEARNT_LATENESS,
    REJECTION,
    ROUGHNESS,
)
from pidtsm_core.estimators import ESTIMATORS, Estimator, estimator_address
from pidtsm_core.laws import LAWS, LawConfig, make_law
from pidtsm_core.parameters import ParameterError, Value, as_float, joint_array
from pidtsm_core.robots import GRAVITY, NO_TOOL, Model, Robot, Tool, make_model, payload_of
from pidtsm_core.signals import Violation
from pidtsm_core.timing import NANOSECONDS

LIMITS = {
    Violation.POSITION: "position",
    Violation.VELOCITY: "velocity",
    Violation.TRACKING: "tracking_error",
    Violation.EXTERNAL_EFFORT: "external_effort",
}
"""NAME of the parameter ``limits.NAME_action``, by violation."""
_SHARE_OF_VELOCITY = 0.8
"""Share of a velocity limit that freedrive may use."""


class LimitsConfig(NamedTuple):
    """Limits of the joints; 0 means no limit."""

    effort: Array  # shape (joints,), N m
    effort_rate: Array  # shape (joints,), N m/s
    min_position: Array  # shape (joints,), rad; no limit if it equals that of max_position
    max_position: Array  # likewise
    velocity: Array  # shape (joints,), rad/s
    tracking_error: Array  # shape (joints,), rad
    external_effort: Array  # shape (joints,), N m
    stops: int  # violations that are faults, see `Violation`


class WatchdogConfig(NamedTuple):
    """How long messages may be missing, ns."""

    state_hold: int
    state_stop: int
    reference: int


class StopConfig(NamedTuple):
    """How a stopped arm is kept safe."""

    bandwidth: float  # rad/s
    fade: float  # s in which the effort fades while no joint state arrives; 0: no fading
    damping: Array  # of the safe effort, shape (joints,), N m s/rad
    gravity: float  # 1: the safe effort compensates gravity, else 0
    holds: bool  # the safe effort holds the arm where it stopped
    brakes: bool  # the arm has brakes, to be engaged when it has stopped


class RehearsalConfig(NamedTuple):
    """When something is rehearsed, ns from the first joint state; 0: never."""

    reset_fault: int
    restart: int
    freedrive: int
    hold: int
    follow: int


class ActivationConfig(NamedTuple):
    """The approach to the reference."""

    blend: float  # s
    distance: float  # rad


class CompensationConfig(NamedTuple):
    """Friction and constant efforts that are compensated."""

    coulomb: Array  # shape (joints,), N m
    viscous: Array  # shape (joints,), N m s/rad
    offset: Array  # shape (joints,), N m
    error_gain: Array  # shape (joints,), 1/s


class AdaptationConfig(NamedTuple):
    """What the controller finds out about its arm."""

    learns: bool  # anything
    learns_friction: bool
    compensates_friction: bool  # what it has learnt
    learns_lateness: bool
    uses_lateness: bool  # what it has learnt
    watches_roughness: bool  # of its commands
    softens: bool  # while a command is rough
    roughness: Array  # what the drives bear, shape (joints,), a share of the effort limit
    bandwidth: Array  # of the poles that what it learns from has passed, shape (joints,), rad/s
    velocity_lags: bool  # see `Estimator`


class DriveConfig(NamedTuple):
    """How late the drives are, see lateness.py."""

    delay: float  # s
    lag: Array  # shape (joints,), s
    inversion: Array  # shape (joints,)
    late: bool  # there may be a delay or a lag


class FreedriveConfig(NamedTuple):
    """The arm in the hands of a person."""

    velocity: Array  # shape (joints,), rad/s
    resistance: Array  # to a push, shape (joints,), N m


class BarrierConfig(NamedTuple):
    """The barrier before the limits of the motion, see barrier.py."""

    margin: Array  # shape (joints,), rad or m
    approach: float  # 1/s


class EstimatorConfig(NamedTuple):
    """The estimator with its parameters."""

    address: int  # see `estimate`
    parameters: Array  # as `Estimator.make_parameters` returns them


class ControllerConfig(NamedTuple):
    """What a step reads."""

    law: LawConfig
    estimator: EstimatorConfig
    limits: LimitsConfig
    watchdog: WatchdogConfig
    stop: StopConfig
    rehearsal: RehearsalConfig
    activation: ActivationConfig
    compensation: CompensationConfig
    adaptation: AdaptationConfig
    drive: DriveConfig
    freedrive: FreedriveConfig
    barrier: BarrierConfig
    compliance: ComplianceConfig
    model: Model  # its parameters have shape (model parameters,)
    firmware: Model  # the model by which the robot's firmware adds gravity: that of the arm without a payload
    plausible_velocity: Array  # shape (joints,), rad/s
    turn: Array  # 2 pi for a continuous joint, else 0, shape (joints,), rad
    uses_model: bool
    freezes: bool  # integrals and adaptation of a joint pause while its effort is limited
    feeds_back: bool  # the applied effort is measured
    rejects: bool  # the disturbance that the observer estimates is subtracted from the law's acceleration
    robot_adds_gravity: bool  # the command is without the effort that carries the arm
    rate_limited: bool  # a joint has a rate limit
    watches: bool  # a joint has a limit of position, velocity or error
    rehearses: bool  # something is rehearsed
    compensates: bool  # a joint has friction or a constant effort that is compensated
    presses: bool  # the friction compensated depends on the error, see joint_friction.py
    breaks_away: bool  # what it has learnt at rest is replaced when a joint leaves, see breakaway.py
    offsets: bool  # a joint has a constant effort
    checks_plausibility: bool  # the measurements of a joint are checked for plausibility
    turns: bool  # a joint is continuous
    keeps_inside: bool  # a joint has a barrier
    senses_contact: bool  # a joint has a limit of the external effort


_Group = TypeVar("_Group", bound=tuple[Any, ...])


def make_config(values: Mapping[str, Value], robot: Robot) -> ControllerConfig:
    """The configuration with these parameters; compiles what they choose.

    Args:
        values: every parameter of `controller_schema`, as `resolve` returns them.
        robot: which they choose.

    Raises:
        ParameterError: the law, or the compliance, needs the geometry of the arm, which is not known.
    """
    joints = len(robot.joints)
    law, estimator = LAWS[str(values["law.name"])], ESTIMATORS[str(values["estimator.name"])]
    limits = _group(LimitsConfig, values, joints, stops=_stops(values))
    compensation = _group(CompensationConfig, values, joints)
    # An effort whose rate is limited follows the error too late, and rings.
    presses = np.where(limits.effort_rate > 0.0, 0.0, compensation.error_gain)
    compensation = compensation._replace(error_gain=presses)
    rehearsal = _group(RehearsalConfig, values, joints)
    plausible = joint_array(values["plausibility.velocity"], joints)
    return ControllerConfig(
        law=make_law(law, values, joints, _tool(robot, values) if law.needs_tree else NO_TOOL),
        estimator=_estimator(estimator, values, robot),
        limits=limits,
        watchdog=_group(WatchdogConfig, values, joints),
        stop=_stop(values, joints),
        rehearsal=rehearsal,
        activation=_group(ActivationConfig, values, joints),
        compensation=compensation,
        adaptation=_adaptation(values, estimator, joints),
        drive=_drive(values, joints),
        freedrive=_freedrive(values, limits),
        barrier=_group(BarrierConfig, values, joints),
        compliance=make_compliance(values, robot),
        model=loaded_model(values, robot),
        firmware=make_model(robot, robot.pack_model(values)),
        plausible_velocity=plausible,
        turn=_turn(robot),
        uses_model=law.uses_model,
        freezes=values["law.anti_windup"] == "conditional",
        feeds_back=values["feedback.effort"] == "measured",
        rejects=bool(values.get(REJECTION.name, False)),
        robot_adds_gravity=values[GRAVITY.name] == "added_by_robot",
        rate_limited=_any(limits.effort_rate),
        watches=_any(
            limits.min_position != limits.max_position, limits.velocity, limits.tracking_error, limits.external_effort
        ),
        rehearses=any(rehearsal),
        compensates=law.uses_model and _any(compensation.coulomb, compensation.viscous, compensation.offset),
        presses=law.uses_model and _any(compensation.error_gain),
        breaks_away=_breaks_away(values, compensation),
        offsets=_any(compensation.offset),
        checks_plausibility=_any(plausible),
        turns=any(robot.continuous),
        keeps_inside=law.uses_model and _any(joint_array(values.get("barrier.margin", 0.0), joints)),
        senses_contact=_any(limits.external_effort) or values.get(SPACE.name, "none") != "none",
    )


def loaded_model(values: Mapping[str, Value], robot: Robot) -> Model:
    """The model of the arm with the payload that the controller knows; arguments as those of `make_config`."""
    return make_model(robot, robot.with_payload(robot.pack_model(values), payload_of(values)))


def _estimator(estimator: Estimator, values: Mapping[str, Value], robot: Robot) -> EstimatorConfig:
    rotor = inertia = np.zeros(len(robot.joints))
    if estimator.prepare is not None:
        model = robot.pack_model(values)
        loaded = robot.with_payload(model, payload_of(values))
        rotor = robot.rotors(model)
        inertia = np.diag(robot.inertia_matrix(loaded, np.array(robot.initial_position, np.float64)))
    return EstimatorConfig(estimator_address(estimator), estimator.make_parameters(values, rotor, inertia))


def _tool(robot: Robot, values: Mapping[str, Value]) -> Tool:
    """The arm as a tree with its tool, see `ArmSample`."""
    if robot.tool is None:
        reason = f"law.name: {values['law.name']} needs the geometry of the arm, but robot {robot.name} has no tool"
        raise ParameterError(reason, "law.name")
    return robot.tool(robot.pack_model(values))


def example_config() -> ControllerConfig:
    """A configuration of one joint, of which only the types matter."""
    one, table = np.zeros(1), np.zeros((1, 1))
    by_kind: dict[Any, Any] = {bool: False, int: 0, float: 0.0, Array: one}
    by_kind[Model] = Model(0, 0, 0, 0, one)
    by_kind[LawConfig] = LawConfig(0, 0, False, np.zeros(1, np.int64), table, one, 0, one)
    by_kind[EstimatorConfig] = EstimatorConfig(0, table)
    groups = (
        LimitsConfig,
        WatchdogConfig,
        StopConfig,
        RehearsalConfig,
        ActivationConfig,
        CompensationConfig,
        AdaptationConfig,
        DriveConfig,
        FreedriveConfig,
        BarrierConfig,
        ComplianceConfig,
        ControllerConfig,
    )
    for group in groups:
        by_kind[group] = group(*(by_kind[kind] for kind in _fields(group).values()))
    found: ControllerConfig = by_kind[ControllerConfig]
    return found


def _group(kind: type[_Group], values: Mapping[str, Value], joints: int, **given: Any) -> _Group:
    """A group of the configuration, of which most fields are the parameters with their name; 0 where there is none.

    Args:
        kind: its type, GroupConfig.
        values: every parameter.
        joints: an array has a number for each joint; an integer is a time in ns.
        given: the other fields.
    """
    group = kind.__name__.removesuffix("Config").lower()
    found = {
        field: given[field] if field in given else _converted(values.get(f"{group}.{field}", 0.0), hint, joints)
        for field, hint in _fields(kind).items()
    }
    return kind(**found)


@cache
def _fields(kind: type) -> dict[str, Any]:
    """Types of the fields of a group, by name."""
    return get_type_hints(kind)


def _converted(value: Value, kind: Any, joints: int) -> Any:
    """A parameter as a field of this type."""
    if kind == Array:
        return joint_array(value, joints)
    return _nanoseconds(value) if kind is int else kind(value)


def _stops(values: Mapping[str, Value]) -> int:
    """See `LimitsConfig.stops`."""
    return sum(v for v, name in LIMITS.items() if values.get(f"limits.{name}_action") == "stop")


def _stop(values: Mapping[str, Value], joints: int) -> StopConfig:
    effort = values["stop.effort"]
    damps = effort in ("damping", "gravity_damping")
    given = {} if damps else {"damping": np.zeros(joints)}
    gravity = float(effort in ("gravity", "gravity_damping"))
    return _group(StopConfig, values, joints, gravity=gravity, holds=effort == "hold", **given)


def _freedrive(values: Mapping[str, Value], limits: LimitsConfig) -> FreedriveConfig:
    found = _group(FreedriveConfig, values, limits.effort.size)
    fastest = np.where(limits.velocity > 0.0, limits.velocity, math.inf)
    return FreedriveConfig(
        velocity=np.minimum(found.velocity, _SHARE_OF_VELOCITY * fastest),
        resistance=found.resistance * limits.effort,
    )


def _adaptation(values: Mapping[str, Value], observer: Estimator, joints: int) -> AdaptationConfig:
    friction, lateness, softening = (values.get(p.name, "none") for p in ADAPTATION)
    learns = friction != "none" or lateness != "none"
    return AdaptationConfig(
        learns=learns,
        learns_friction=friction != "none",
        compensates_friction=friction == "learn",
        learns_lateness=lateness != "none",
        uses_lateness=lateness == "learn",
        watches_roughness=softening != "none",
        softens=softening == "act",
        roughness=joint_array(values.get(ROUGHNESS.name, 0.0), joints),
        bandwidth=observer.poles * joint_array(values["estimator.bandwidth"], joints) if learns else np.zeros(joints),
        velocity_lags=observer.velocity_lags,
    )


def _breaks_away(values: Mapping[str, Value], compensation: CompensationConfig) -> bool:
    """Whether joints leave rest as breakaway.py describes: wanted, and friction is compensated."""
    compensates = _any(compensation.coulomb) or values.get(LEARNT_FRICTION.name) == "learn"
    return bool(values.get(BREAKAWAY.name, False)) and bool(values.get(REJECTION.name, False)) and compensates


def _drive(values: Mapping[str, Value], joints: int) -> DriveConfig:
    found = _group(DriveConfig, values, joints, late=False)
    learns = values.get(LEARNT_LATENESS.name, "none") != "none"
    return found._replace(late=learns or found.delay > 0.0 or _any(found.lag))


def _turn(robot: Robot) -> Array:
    joints = len(robot.joints)
    return np.where(robot.continuous, 2.0 * math.pi, 0.0) if robot.continuous else np.zeros(joints)


def _any(*arrays: Array) -> bool:
    """Whether a number is not zero."""
    return any(bool(array.any()) for array in arrays)


def _nanoseconds(value: Value) -> int:
    """Convert a time in s to ns, limited so that the sum of two times fits into 64 bits."""
    return min(round(as_float(value) * NANOSECONDS), 2**61)
