"""All parameters of the controller that affect its effort, in nodes and rollouts."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from pidtsm_core.control.barrier_parameters import BARRIER
from pidtsm_core.control.compliance_parameters import check_compliance, compliance_parameters
from pidtsm_core.control.friction_parameters import BREAKAWAY, FRICTION
from pidtsm_core.estimators import ESTIMATORS, Estimator
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Parameter, ParameterError, chosen, prefixed
from pidtsm_core.robots import GRAVITY, Robot, find_robot, payload_schema, robot_schema

LAW_NAME = Parameter("law.name", "piddtsm", "control law", choices=LAWS, read_only=True)
ESTIMATOR_NAME = Parameter(
    "estimator.name",
    "filtered_difference",
    "state estimator; exact works in a rollout only, the node rejects it",
    choices=ESTIMATORS,
    read_only=True,
)


def _action(name: str, limits: str, default: str = "stop") -> Parameter:
    return Parameter(
        f"limits.{name}_action",
        default,
        f"what the controller does if a joint exceeds {limits}: stop (a fault) or warn",
        choices=("stop", "warn"),
    )


def _limit(name: str, description: str, unit: str, action: str = "stop") -> tuple[Parameter, Parameter]:
    return (
        Parameter(f"limits.{name}", 0.0, f"{description}; 0: none", unit, minimum=0.0, per_joint=True),
        _action(name, f"limits.{name}", action),
    )


_LIMITS = (
    Parameter(
        "limits.effort_rate",
        0.0,
        "largest rate of change of the torque; 0: none. If the law demands more, the arm approaches its reference more "
        "slowly",
        "N m/s",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "limits.min_position",
        0.0,
        "smallest position; none if it equals limits.max_position. A joint exceeds it if it is beyond by more than 1 % "
        "of its range, or by 0.01 if that is less. Change both at once",
        "rad",
        per_joint=True,
    ),
    Parameter("limits.max_position", 0.0, "largest position", "rad", per_joint=True),
    _action("position", "limits.min_position or limits.max_position"),
    *_limit("velocity", "largest estimated velocity in either direction", "rad/s"),
    *_limit("tracking_error", "largest error in either direction", "rad"),
)
CONTACT = _limit(
    "external_effort",
    "largest torque that something outside the arm exerts on a joint, by the model, averaged over 0.1 s. Beyond it, "
    "the arm is taken to be in contact: with law.anti_windup: conditional, all integrals and adaptation pause",
    "N m",
    "warn",
)
_RANGE = ("limits.min_position", "limits.max_position")
_SAFETY = (
    Parameter(
        "activation.distance",
        1.0,
        "the node does not become active while a joint is farther than this from its reference",
        "rad",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "activation.blend",
        0.8,
        "duration of the approach from the current position to a reference that the controller starts to follow, "
        "longer where limits.velocity requires it; 0: no approach",
        "s",
        minimum=0.0,
    ),
    Parameter(
        "watchdog.state_hold",
        0.002,
        "a gap between joint states is counted on /diagnostics (late joint states) if it is longer than both this and "
        "two nominal periods; the last torque stays applied",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "watchdog.state_stop",
        0.02,
        "a gap between joint states is a fault, which stops the arm, if it is longer than both this and five nominal "
        "periods",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "watchdog.reference",
        0.1,
        "largest difference between the stamps of the reference and of the joint state. Beyond it the controller holds "
        "its position until a reference arrives with at most half this difference",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "plausibility.velocity",
        20.0,
        "a measurement is implausible if it is farther from the estimate than the arm can have moved at this velocity "
        "since the last one, plus 0.01 rad. Up to five in a row are replaced with the estimate, more are a fault; "
        "0: no check",
        "rad/s",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "stop.effort",
        "hold",
        "safe torque after a fault. hold: keeps the arm where it stopped, even if the model is wrong; the others: "
        "gravity compensation and damping, one of them, or no torque",
        choices=("hold", "gravity_damping", "gravity", "damping", "zero"),
    ),
    Parameter(
        "stop.bandwidth",
        8.0,
        "bandwidth of the position control that holds the arm (stop.effort: hold)",
        "rad/s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "stop.fade",
        5.0,
        "time in which the holding torque fades to zero while no joint state arrives (stop.effort: hold); 0: no fading",
        "s",
        minimum=0.0,
    ),
    Parameter("stop.damping", 20.0, "damping of the safe torque", "N m s/rad", minimum=0.0, per_joint=True),
    Parameter(
        "stop.brakes",
        False,
        "whether the arm has brakes: ~/brakes (std_msgs/Bool) engages them when the arm has come to rest after a "
        "fault, or when joint states stop arriving",
        read_only=True,
    ),
)
FREEDRIVE = (
    Parameter(
        "freedrive.velocity",
        0.5,
        "largest velocity in freedrive, and of the first approach to a reference after it; if limits.velocity is less "
        "than 1.25 times that, 0.8 times limits.velocity",
        "rad/s",
        minimum=0.0,
        exclusive=True,
        per_joint=True,
    ),
    Parameter(
        "freedrive.resistance",
        0.05,
        "what a push must overcome to move the arm in freedrive, as a share of limits.effort; errors of the model that "
        "are smaller do not move the arm",
        minimum=0.0,
        maximum=0.5,
        exclusive=True,
        per_joint=True,
    ),
)
_FEEDBACK = Parameter(
    "feedback.effort",
    "commanded",
    "torque that the estimator and the integrals use. commanded: the controller's own; measured: the effort in the "
    "joint states, as the drives report it, which reveals lost commands and closed brakes",
    choices=("commanded", "measured"),
    read_only=True,
)


def _rehearsed(name: str, call: str) -> Parameter:
    description = f"rehearsal: {call} once, at this time after the first joint state; 0: never"
    return Parameter(f"rehearsal.{name}", 0.0, description, "s", minimum=0.0)


_REHEARSAL = (
    Parameter(
        "rehearsal.reset_fault",
        0.0,
        "rehearsal: reset a fault once, at this time after the first joint state or as soon afterwards as "
        "~/reset_fault would succeed; 0: never",
        "s",
        minimum=0.0,
    ),
    Parameter(
        "rehearsal.restart",
        0.0,
        "rehearsal: discard all state once, at this time after the first joint state, as a restart does; 0: never",
        "s",
        minimum=0.0,
    ),
    _rehearsed("freedrive", "call ~/freedrive with true"),
    _rehearsed("hold", "call ~/hold with true"),
    _rehearsed("follow", "call ~/hold with false"),
)

REJECTION = Parameter(
    "law.disturbance_rejection",
    False,
    "whether the disturbance that the observer estimates is subtracted from the commanded acceleration; needs "
    "estimator.name: extended_state_observer or elastic_joint_observer",
    read_only=True,
)
LEARNT_FRICTION = Parameter(
    "adaptation.friction",
    "none",  # Not "off", which is false in YAML.
    "find friction beyond compensation.* while the arm moves. learn: compensate the Coulomb friction that is certain; "
    "warn: only report it. Needs estimator.name: extended_state_observer or elastic_joint_observer",
    choices=("none", "warn", "learn"),
)
_DELAY = Parameter(
    "drive.delay",
    0.0,
    "time from the stamp of the joint state until the command that answers it acts, as far as it is known: the law "
    "sees the motion predicted for that time",
    "s",
    minimum=0.0,
    maximum=0.1,
)
_LAG = Parameter(
    "drive.lag",
    0.0,
    "time constant with which the effort of a drive follows its command, as far as it is known",
    "s",
    minimum=0.0,
    maximum=0.2,
    per_joint=True,
)
_INVERSION = Parameter(
    "drive.inversion",
    4.0,
    "how many times faster than with drive.lag the effort follows; noise is amplified as much. 1: the lag stays",
    minimum=1.0,
    maximum=50.0,
    per_joint=True,
)
DRIVE = (_DELAY, _LAG, _INVERSION)
LEARNT_LATENESS = Parameter(
    "adaptation.lateness",
    "none",
    "find how late the drives are beyond drive.* while the arm moves. learn: compensate what is likely; warn: only "
    "report it. Needs estimator.name: extended_state_observer",
    choices=("none", "warn", "learn"),
)
SOFTENING = Parameter(
    "adaptation.softening",
    "none",
    "watch how rough the command of each joint is. act: slow law and observer down until all are quiet; warn: only "
    "report it. Needs estimator.name: extended_state_observer or elastic_joint_observer",
    choices=("none", "warn", "act"),
)
ROUGHNESS = Parameter(
    "adaptation.roughness",
    0.005,
    "mean change of the command from one sample to the next, beside what moves the arm, that the drive of a joint "
    "bears, as a share of limits.effort",
    minimum=0.0,
    exclusive=True,
    maximum=0.1,
    per_joint=True,
)
ADAPTATION = (LEARNT_FRICTION, LEARNT_LATENESS, SOFTENING)
"""What the controller finds out."""
_TOUCH = 0.25
"""Share of the effort limit of a joint that only contact exerts, not a payload or an error of the model."""


def _of_robot(parameters: Iterable[Parameter], robot: Robot) -> tuple[Parameter, ...]:
    """The parameters, with what the robot's description contains as defaults."""
    bounded = [limits if math.isfinite(limits[1] - limits[0]) else (0.0, 0.0) for limits in robot.position_limits]
    described = {
        "limits.min_position": tuple(low for low, _ in bounded),
        "limits.max_position": tuple(high for _, high in bounded),
        "limits.velocity": tuple(limit if math.isfinite(limit) else 0.0 for limit in robot.velocity_limit),
        "compensation.coulomb": robot.friction,
        "compensation.viscous": robot.damping,
    }
    return tuple(replace(p, default=described.get(p.name) or p.default) for p in parameters)


def _contact(settings: Mapping[str, object], robot: Robot) -> tuple[Parameter, ...]:
    """How contact is recognised and yielded to, with defaults that follow from ``limits.effort``."""
    try:
        limit = np.broadcast_to(np.asarray(settings.get("limits.effort", robot.effort_limit), float), len(robot.joints))
    except (TypeError, ValueError):  # It is rejected elsewhere.
        limit = np.full(len(robot.joints), math.inf)
    share = tuple(np.where(np.isfinite(limit), _TOUCH * limit, 0.0).tolist())
    return replace(CONTACT[0], default=share), CONTACT[1], *compliance_parameters(limit)


def _check_range(settings: Mapping[str, object], robot: Robot) -> None:
    """Check that no joint has a smallest position above its largest one; values of a wrong type are not judged here."""
    low, high = _of_robot((p for p in _LIMITS if p.name in _RANGE), robot)
    try:
        least, most = (np.asarray(settings.get(p.name, p.default), dtype=np.float64) for p in (low, high))
        crossed = np.any(least > most)
    except (TypeError, ValueError):
        return
    if crossed:
        raise ParameterError(f"{low.name}: {least.tolist()} exceeds {high.name}, {most.tolist()}", low.name)


def _check_observer(settings: Mapping[str, object], estimator: Estimator) -> None:
    """Check that the estimator finds the disturbance that other parameters use."""
    finds = [e.name for e in ESTIMATORS.members if e.finds_disturbance]
    teaches = {p: [e.name for e in ESTIMATORS.members if p.name in e.teaches] for p in ADAPTATION}
    uses = {
        REJECTION: (settings.get(REJECTION.name) is True, finds),
        **{p: (settings.get(p.name, "none") != "none", names) for p, names in teaches.items()},
        **{p: (np.any(np.asarray(settings.get(p.name, 0.0), object) != 0.0), finds) for p in (_DELAY, _LAG)},
    }
    if settings.get(_FEEDBACK.name) == "measured" and settings.get("estimator.at_links") is True:
        reason = "torque sensors behind the gears measure what the springs carry, not the motors; take commanded"
        raise ParameterError(f"{_FEEDBACK.name}: with estimator.at_links, {reason}", _FEEDBACK.name)
    for parameter, (used, capable) in uses.items():
        if used and estimator.name not in capable:
            reason = f"{parameter.name}: estimator.name must be {' or '.join(capable)}, not {estimator.name}"
            raise ParameterError(reason, parameter.name)


def controller_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the controller; they depend on ``law.name``, ``estimator.name`` and the robot.

    Raises:
        ParameterError: see `find_robot`, `payload_schema` and `check_compliance`, or the estimator does not estimate
            the disturbance that is to be rejected, or a joint has a smallest position above its largest one.
    """
    robot = find_robot(settings)
    _check_range(settings, robot)
    law = LAWS[chosen(settings, LAW_NAME)]
    estimator = ESTIMATORS[chosen(settings, ESTIMATOR_NAME)]
    _check_observer(settings, estimator)
    check_compliance(settings, REJECTION.name)
    return (
        LAW_NAME,
        *prefixed("law", law.parameters(settings)),
        *((REJECTION, BREAKAWAY, LEARNT_FRICTION, LEARNT_LATENESS, *DRIVE) if law.uses_model else ()),
        *((SOFTENING, ROUGHNESS) if law.softens else ()),
        ESTIMATOR_NAME,
        *prefixed("estimator", estimator.parameters),
        *robot_schema(settings, robot),
        *payload_schema(settings, "mass at the tool that the controller knows", robot),
        *_of_robot((*FRICTION, *_LIMITS), robot),
        *(_contact(settings, robot) if law.uses_model else ()),
        *_SAFETY,
        *((*FREEDRIVE, *BARRIER) if law.uses_model else ()),
        _FEEDBACK,
        GRAVITY,
        *_REHEARSAL,
    )
