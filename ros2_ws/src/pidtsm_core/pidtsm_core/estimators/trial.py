"""Whether an estimator from outside can be used."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.errors import MemberError
from pidtsm_core.estimators.base import Estimator, Sample
from pidtsm_core.estimators.calls import estimate, estimator_address
from pidtsm_core.parameters.family import SLOTS, check_parameters
from pidtsm_core.robots import ROBOTS, make_model

_DT = 0.001
_SAMPLES = 400
_WRONG = 0.1
"""rad; error of the position of an arm at rest that no estimator may have."""


@njit
def _rest(address: int, first: Sample, sample: Sample, count: int, p: Array, x: Array, estimates: Array) -> None:
    """Estimate the motion of an arm at rest."""
    estimate(address, first, p, x, estimates)
    for _ in range(count):
        estimate(address, sample, p, x, estimates)


def try_member(estimator: Estimator) -> None:
    """Compile an estimator with its default parameters, and see what it makes of an arm at rest.

    Raises:
        MemberError: its parameters do not fit, it does not compile, or it does not find that the arm rests.
    """
    what = f"estimator {estimator.name}"
    check_parameters(what, estimator.parameters)
    robot = ROBOTS.own[0]
    joints = len(robot.joints)
    packed = robot.pack_model({f"robot.{each.name}": each.default for each in robot.parameters})
    values = {f"estimator.{each.name}": each.default for each in estimator.parameters}
    inertia = np.diag(robot.inertia_matrix(packed, np.array(robot.initial_position, np.float64)))
    p = estimator.make_parameters(values, robot.rotors(packed), inertia)
    rows = estimator.rows(joints) if estimator.rows else 0
    q, x, estimates = np.array([0.3, -0.2]), np.zeros((joints + rows, SLOTS)), np.zeros((3, joints))
    effort = np.zeros((1, joints))
    robot.dynamics.inverse_dynamics(q, np.zeros(joints), np.zeros((1, joints)), packed, effort)
    first = Sample(q, np.zeros((2, joints)), 0.0, effort[0], make_model(robot, packed), 1.0)
    with compiles(what):
        address = estimator_address(estimator)
    _rest(address, first, first._replace(dt=_DT), _SAMPLES, p, x, estimates)
    check_finite(what, estimates, "an arm at rest")
    if np.abs(estimates[0] - q).max() > _WRONG:
        raise MemberError(f"{what} finds an arm that rests at {q.tolist()} to be at {estimates[0].tolist()}")
