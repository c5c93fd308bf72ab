"""Whether a robot from outside can be used."""

import numpy as np

from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.errors import MemberError
from pidtsm_core.parameters.family import check_parameters
from pidtsm_core.robots.base import Robot
from pidtsm_core.robots.calls import dynamics_addresses

_EXACT = 1e-6
_MOST_PARAMETERS = 64


def try_member(robot: Robot) -> None:
    """Compile a robot with its default parameters, and compare its inverse with its forward dynamics.

    Raises:
        MemberError: its parameters do not fit, it does not compile, its inertia matrix is not symmetric and positive
            definite, or its forward dynamics are not the inverse of its inverse dynamics.
    """
    what = f"robot {robot.name}"
    check_parameters(what, robot.parameters, _MOST_PARAMETERS)
    joints = len(robot.joints)
    if len(robot.effort_limit) != joints or len(robot.initial_position) != joints:
        raise MemberError(f"{what}: effort_limit and initial_position need one number for each of its joints")
    with compiles(what):
        dynamics_addresses(robot.dynamics)
    p = robot.pack_model({f"robot.{each.name}": each.default for each in robot.parameters})
    random = np.random.default_rng(0)
    for _ in range(3):
        q, dq, ddq = random.uniform(-1.0, 1.0, (3, joints))
        effort, back = np.zeros((1, joints)), np.zeros(joints)
        robot.dynamics.inverse_dynamics(q, dq, ddq.reshape(1, joints), p, effort)
        given = f"q = {q.round(3).tolist()}"
        check_finite(what, effort, given)
        inertia = robot.inertia_matrix(p, q)
        if np.linalg.eigvalsh(inertia).min() <= 0.0:
            raise MemberError(f"{what}: its inertia matrix is not positive definite for {given}")
        robot.dynamics.forward_dynamics(q, dq, effort[0], p, back)
        if np.abs(back - ddq).max() > _EXACT * (1.0 + np.abs(ddq).max()):
            raise MemberError(f"{what}: its forward dynamics are not the inverse of its inverse dynamics for {given}")
