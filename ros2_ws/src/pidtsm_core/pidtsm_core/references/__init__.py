"""References: from time to q_d, q_d', q_d''. One per file; `REFERENCES` contains the ones imported here."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.parameters import Parameter, Value, as_float, chosen, joint_array, names, prefixed
from pidtsm_core.parameters.family import Family
from pidtsm_core.references.article import ARTICLE
from pidtsm_core.references.base import Reference
from pidtsm_core.references.calls import evaluate_reference, reference_address
from pidtsm_core.references.chirp import CHIRP
from pidtsm_core.references.csv import CSV
from pidtsm_core.references.minimum_jerk import MINIMUM_JERK
from pidtsm_core.references.pick_and_place import PICK_AND_PLACE
from pidtsm_core.references.sines import SINES
from pidtsm_core.timing import sum_of_times

__all__ = [
    "REFERENCES",
    "MotionConfig",
    "Reference",
    "ReferenceMotion",
    "drops_out",
    "evaluate_motion",
    "extrapolate",
    "reference_joints",
    "reference_schema",
]

REFERENCES: Family[Reference] = Family.of(Reference, "references", globals(), "pidtsm_core.references.trial")

_NAME = Parameter("reference.name", "article", "desired motion", choices=REFERENCES, read_only=True)
_JOINTS = Parameter(
    "joints",
    ("joint1", "joint2"),
    "names of the joints, in the order of the reference",
    per_joint=True,
    read_only=True,
)


def reference_joints(settings: Mapping[str, object]) -> int:
    """Number of joints of the reference ``reference.name``; if it accepts any number, the length of ``joints``."""
    given = settings.get(_JOINTS.name, _JOINTS.default)
    named = len(given) if isinstance(given, (list, tuple)) else 0
    return REFERENCES[chosen(settings, _NAME)].joints or named


_EVENTS = (
    Parameter("jump.position", 0.0, "step of the reference's position at jump.time", "rad", per_joint=True),
    Parameter("jump.time", 0.0, "time of the jump, from the start of the reference", "s", minimum=0.0),
    Parameter(
        "dropout.time",
        0.0,
        "time from the start of the reference at which a dropout of all references begins",
        "s",
        minimum=0.0,
    ),
    Parameter("dropout.duration", 0.0, "how long all references are missing; 0: no dropout", "s", minimum=0.0),
)
_FEEDFORWARD = Parameter(
    "feedforward.effort",
    0.0,
    "torque that the controller adds to its command while it follows the reference, such as that of a load that its "
    "model lacks",
    "N m",
    per_joint=True,
)


def reference_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the trajectory; they depend on ``reference.name``."""
    reference = REFERENCES[chosen(settings, _NAME)]
    return (
        _JOINTS,
        _NAME,
        *prefixed("reference", reference.parameters),
        *_EVENTS,
        _FEEDFORWARD,
    )


@njit
def extrapolate(desired: Array, dt: float, later: Array) -> None:
    """Write to `later` q_d, q_d', q_d'' (shape (3, joints)) extrapolated by dt seconds with constant q_d''."""
    for j in range(desired.shape[1]):
        later[0, j] = desired[0, j] + dt * (desired[1, j] + 0.5 * dt * desired[2, j])
        later[1, j] = desired[1, j] + dt * desired[2, j]
        later[2, j] = desired[2, j]


class MotionConfig(NamedTuple):
    """A desired motion in the form that compiled code reads."""

    reference: int  # address of `Reference.evaluate`
    parameters: Array  # as `Reference.pack` returns them
    jump: Array  # shape (joints,), rad
    jump_time: float  # s
    dropout_begin: float  # s
    dropout_end: float  # s
    feedforward: Array  # effort that is fed forward, shape (joints,), N m


@inlined
def evaluate_motion(config: MotionConfig, t: float, desired: Array) -> None:
    """Write q_d, q_d', q_d'' at t (s from the start) to desired, shape (3, joints), rad, rad/s, rad/s^2."""
    evaluate_reference(config.reference, t, config.parameters, desired)
    if t >= config.jump_time:
        for j in range(desired.shape[1]):
            desired[0, j] += config.jump[j]


@inlined
def drops_out(config: MotionConfig, t: float) -> bool:
    """Whether the reference at t (s from the start) is missing."""
    return config.dropout_begin <= t < config.dropout_end


@njit
def _evaluate_now(config: MotionConfig, t: float, desired: Array) -> None:
    """`evaluate_motion` for Python."""
    evaluate_motion(config, t, desired)


class ReferenceMotion:
    """A desired motion, built from checked parameters.

    Attributes:
        joints: number of joints.
        config: the argument of `evaluate_motion`.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        """Prepare the motion.

        Args:
            values: every parameter of `reference_schema`, as `resolve` returns them.

        Raises:
            ParameterError: a file cannot be used.
        """
        reference = REFERENCES[str(values["reference.name"])]
        self.joints = len(names(values["joints"]))
        begin = as_float(values["dropout.time"])
        self.config = MotionConfig(
            reference=reference_address(reference),
            parameters=np.ascontiguousarray(reference.pack(values, "reference", self.joints), np.float64),
            jump=joint_array(values["jump.position"], self.joints),
            jump_time=as_float(values["jump.time"]),
            dropout_begin=begin,
            dropout_end=sum_of_times(begin, as_float(values["dropout.duration"])),
            feedforward=joint_array(values[_FEEDFORWARD.name], self.joints),
        )

    def evaluate(self, t: float, desired: Array) -> None:
        """See `evaluate_motion`."""
        _evaluate_now(self.config, t, desired)

    def start(self) -> Array:
        """q_d, q_d', q_d'' at 0 s, shape (3, joints); it runs as Python, because nothing is compiled for one call."""
        desired = np.zeros((3, self.joints))
        evaluate_motion(self.config, 0.0, desired)
        return desired

    def drops_out(self, t: float) -> bool:
        """See `drops_out`."""
        return drops_out(self.config, t)
