"""Whether a disturbance from outside can be used."""

import numpy as np

from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.parameters.family import check_parameters
from pidtsm_core.simulation.disturbances.base import Disturbance
from pidtsm_core.simulation.disturbances.calls import add_disturbance, make_disturbance

_JOINTS = 3
"""Of a disturbance for any number of joints."""


def try_member(disturbance: Disturbance) -> None:
    """Compile a disturbance with its default parameters, and see what it adds at some times and motions.

    Raises:
        MemberError: its parameters do not fit, it does not compile, or it adds what is not finite.
    """
    what = f"disturbance {disturbance.name}"
    check_parameters(what, disturbance.parameters)
    joints = disturbance.joints or _JOINTS
    values = {f"disturbance.{each.name}": each.default for each in disturbance.parameters}
    with compiles(what):
        made = make_disturbance(disturbance, values, joints)
    for t in (0.0, 0.37, 20.0):
        for size in (0.0, 0.8, -2.0):
            q = np.full(joints, size)
            effort = np.zeros(joints)
            add_disturbance(made, t, q, 0.5 * q, effort)
            check_finite(what, effort, f"t = {t:g}, q = {size:g}, q' = {0.5 * size:g}")
