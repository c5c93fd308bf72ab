"""Every parameter of the controller that changes its effort; nodes and rollouts read them alike."""

from collections.abc import Mapping

from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Parameter, chosen, prefixed
from pidtsm_core.robots import robot_schema

LAW_NAME = Parameter("law.name", "piddtsm", "control law", choices=LAWS.names, read_only=True)
ESTIMATOR_NAME = Parameter(
    "estimator.name", "filtered_difference", "state estimator", choices=ESTIMATORS.names, read_only=True
)


def _limit(name: str, description: str, unit: str) -> tuple[Parameter, Parameter]:
    return (
        Parameter(f"limits.{name}", 0.0, f"{description}; 0: none", unit, minimum=0.0, per_joint=True),
        Parameter(
            f"limits.{name}_action",
            "stop",
            f"what the controller does when a joint exceeds limits.{name}: stop, which is a fault, or warn",
            choices=("stop", "warn"),
        ),
    )


_LIMITS = (
    Parameter(
        "limits.effort_rate",
        0.0,
        "largest change of the torque; 0: none. Where the law wants more than the limit lets through, the arm takes a "
        "slower way to its reference",
        "N m/s",
        minimum=0.0,
        per_joint=True,
    ),
    *_limit("position", "largest angle in either direction", "rad"),
    *_limit("velocity", "largest estimated velocity in either direction", "rad/s"),
    *_limit("tracking_error", "largest error in either direction", "rad"),
)
_SAFETY = (
    Parameter(
        "activation.distance",
        1.0,
        "activation is refused while a joint is farther from its reference",
        "rad",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "activation.blend",
        0.8,
        "how long the arm takes from where it is to a reference that it begins to follow; 0: no time",
        "s",
        minimum=0.0,
    ),
    Parameter(
        "watchdog.state_hold",
        0.002,
        "joint states later than this, and than two nominal periods, are counted as late; the last torque stays",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "watchdog.state_stop",
        0.02,
        "a gap between joint states that is longer than this, and than five nominal periods, stops the arm: a fault",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "watchdog.reference",
        0.1,
        "the controller does not follow a reference that is older than this, or further ahead: it holds its position "
        "until a reference arrives that is at most half as old",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "plausibility.velocity",
        20.0,
        "a measurement that is farther from where the estimates put the joint than this velocity brings it is not "
        "believed: five in a row are replaced by what the estimates say, more are a fault; 0: every one is believed",
        "rad/s",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "stop.effort",
        "hold",
        "safe torque after a fault: hold, which keeps the arm where it stopped, whatever the model lacks; gravity "
        "compensation, damping, both or nothing",
        choices=("hold", "gravity_damping", "gravity", "damping", "zero"),
    ),
    Parameter(
        "stop.bandwidth",
        8.0,
        "of the position control that holds the arm (stop.effort: hold)",
        "rad/s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "stop.fade",
        5.0,
        "time in which the holding torque fades to nothing while no joint state arrives (stop.effort: hold); 0: it "
        "stays",
        "s",
        minimum=0.0,
    ),
    Parameter("stop.damping", 20.0, "damping of the safe torque", "N m s/rad", minimum=0.0, per_joint=True),
    Parameter(
        "stop.brakes",
        False,
        "the arm has brakes: ~/brakes (std_msgs/Bool) engages them when the arm has come to rest after a fault, or "
        "when no joint state arrives",
        read_only=True,
    ),
)
_FEEDBACK = Parameter(
    "feedback.effort",
    "commanded",
    "torque that the estimator and the integrals count on: commanded, the controller's own; measured, the effort of "
    "the joint states, as drives report it, which shows lost commands and closed brakes",
    choices=("commanded", "measured"),
    read_only=True,
)
_REHEARSAL = (
    Parameter(
        "rehearsal.reset_fault",
        0.0,
        "to rehearse faults: resets a fault at this time after the first joint state, or as soon after it as "
        "~/reset_fault would; once; 0: never",
        "s",
        minimum=0.0,
    ),
    Parameter(
        "rehearsal.restart",
        0.0,
        "to rehearse faults: the controller forgets everything at this time after the first joint state, as after a "
        "restart; once; 0: never",
        "s",
        minimum=0.0,
    ),
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
        *_LIMITS,
        *_SAFETY,
        _FEEDBACK,
        *_REHEARSAL,
    )
