"""References: time to q_d, q_d', q_d''. One reference a file; what is imported here is in `REFERENCES`."""

from collections.abc import Mapping

from numba import literal_unroll

from pidtsm_core.compiled import njit
from pidtsm_core.family import Family
from pidtsm_core.parameters import Array, Parameter, Value, chosen, names, prefixed
from pidtsm_core.references.article import ARTICLE
from pidtsm_core.references.base import Reference
from pidtsm_core.references.chirp import CHIRP
from pidtsm_core.references.csv import CSV
from pidtsm_core.references.minimum_jerk import MINIMUM_JERK
from pidtsm_core.references.sines import SINES

__all__ = [
    "REFERENCES",
    "Reference",
    "ReferenceMotion",
    "evaluate_reference",
    "extrapolate",
    "reference_joints",
    "reference_schema",
]

REFERENCES: Family[Reference] = Family.of(Reference, globals())

_NAME = Parameter("reference.name", "article", "desired motion", choices=REFERENCES.names, fixed=True)
_JOINTS = Parameter(
    "joints",
    ("joint1", "joint2"),
    "names of the joints, in the order of the reference",
    per_joint=True,
    fixed=True,
)


def reference_joints(settings: Mapping[str, object]) -> int:
    """Number of joints of the reference that ``reference.name`` chooses; where it takes any, that of ``joints``."""
    given = settings.get(_JOINTS.name, _JOINTS.default)
    named = len(given) if isinstance(given, (list, tuple)) else 0
    return REFERENCES[chosen(settings, _NAME)].joints or named


def reference_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the trajectory; ``reference.name`` decides which there are."""
    reference = REFERENCES[chosen(settings, _NAME)]
    return (
        _JOINTS,
        _NAME,
        *prefixed("reference", reference.parameters),
    )


_EVALUATE = tuple(reference.evaluate for reference in REFERENCES.members)


@njit
def evaluate_reference(number: int, t: float, p: Array, desired: Array) -> None:
    """Write q_d, q_d', q_d'': see `Reference.evaluate`; `number` is the reference's place in `REFERENCES`."""
    i = 0
    for function in literal_unroll(_EVALUATE):
        if i == number:
            function(t, p, desired)
        i += 1


@njit
def extrapolate(desired: Array, dt: float, later: Array) -> None:
    """Continue q_d, q_d', q_d'' (shape (3, joints)) over dt seconds with constant q_d'', into `later`."""
    for j in range(desired.shape[1]):
        later[0, j] = desired[0, j] + dt * (desired[1, j] + 0.5 * dt * desired[2, j])
        later[1, j] = desired[1, j] + dt * desired[2, j]
        later[2, j] = desired[2, j]


class ReferenceMotion:
    """A desired motion, built from checked parameters.

    Attributes:
        joints: number of joints.
        number, parameters: what `evaluate_reference` takes.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        """Prepare the motion.

        Args:
            values: every parameter of `reference_schema`, as `resolve` returns them.

        Raises:
            ParameterError: a file that cannot be used.
        """
        reference = REFERENCES[str(values["reference.name"])]
        self.joints = len(names(values["joints"]))
        self.number = REFERENCES.number(reference.name)
        self.parameters = reference.pack(values, "reference", self.joints)

    def evaluate(self, t: float, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at t (s) to desired, shape (3, joints), rad, rad/s, rad/s^2."""
        evaluate_reference(self.number, t, self.parameters, desired)
