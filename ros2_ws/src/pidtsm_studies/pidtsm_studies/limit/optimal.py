"""The smallest RMSE that any controller of the two-link arm can reach, by optimal control.

The torque over the first seconds is chosen with full knowledge of arm, disturbance and reference, under the torque
limits, so that the arm meets its reference; from then on it can follow without error. Direct multiple shooting (Bock
and Plitt 1984) with RK4 and a torque that is constant over each interval, solved by IPOPT through CasADi.

Each joint's mean squared error is weighted by the inverse of the one found before, so that a per cent counts the same
in every joint: no controller can improve one joint without losing at least the same share in the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError, how_to_install
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import Value, as_float, joint_array
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.robots.two_link import TWO_LINK

_HORIZON, _INTERVALS = 2.0, 400
"""s, and number of intervals of constant torque. The arm meets its reference in less than 1.5 s."""
_ROUNDS = 4
"""Number of times that the weights of the joints are found."""


@dataclass(frozen=True)
class Limit:
    """The limit of a scenario.

    Attributes:
        rmse: of each joint over the whole run, rad.
        time: of the samples, s, shape (intervals + 1,).
        error: e = q - q_d, rad, shape (intervals + 1, 2).
        effort: N m, shape (intervals, 2).
    """

    rmse: tuple[float, ...]
    time: Array
    error: Array
    effort: Array


def find_limit(experiment: Experiment) -> Limit:
    """Compute the limit of a scenario of the two-link arm with ideal hardware.

    Raises:
        UsageError: CasADi is not installed, or the scenario is of another arm, disturbance or payload.
        RuntimeError: the optimisation does not converge.
    """
    casadi = _casadi()
    values = experiment.values
    arm = values["simulator"]
    if arm[DESCRIPTION.name] != TWO_LINK.name or as_float(arm["payload.mass"]):
        raise UsageError("the limit is known for the two-link arm without a payload only")
    step = _HORIZON / _INTERVALS
    time = step * np.arange(_INTERVALS + 1)
    motion, desired = ReferenceMotion(values["trajectory"]), np.zeros((time.size, 3, 2))
    for t, row in zip(time, desired, strict=True):
        motion.evaluate(float(t), row)
    start = np.concatenate([joint_array(arm["initial_position"], 2), np.zeros(2)])
    limits = joint_array(arm["limits.effort"], 2)
    problem = casadi.Opti()
    state, effort = problem.variable(4, time.size), problem.variable(2, _INTERVALS)
    advance = _step(casadi, arm, step).map(_INTERVALS)
    problem.subject_to(state[:, 1:] == advance(state[:, :-1], effort))
    problem.subject_to(state[:, 0] == start)
    problem.subject_to(state[:, -1] == desired[-1, :2].reshape(-1))
    for joint, limit in enumerate(limits.tolist()):
        problem.subject_to(problem.bounded(-limit, effort[joint, :], limit))
    error = state[:2, :] - desired[:, 0].T
    weights = step * np.r_[0.5, np.ones(_INTERVALS - 1), 0.5]  # trapezoids
    weights[0] += 0.5 / as_float(arm["rate"])  # The metric is a sum over samples, which begins with the largest error.
    squared = [casadi.dot(error[joint, :] ** 2, weights[np.newaxis]) for joint in range(2)]
    importance = problem.parameter(2)
    problem.minimize(importance[0] * squared[0] + importance[1] * squared[1])
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_iter": 500})
    problem.set_initial(state, desired[:, :2].reshape(time.size, 4).T)
    share = np.ones(2)
    for _ in range(_ROUNDS):
        problem.set_value(importance, share)
        try:
            found = problem.solve()
        except RuntimeError:
            if problem.return_status() == "User_Requested_Stop":
                raise KeyboardInterrupt from None
            raise RuntimeError(f"IPOPT: {problem.return_status()}") from None
        problem.set_initial(found.value_variables())
        share = np.array([1.0 / found.value(each) for each in squared])
    return Limit(
        rmse=tuple(float(each) for each in np.sqrt(1.0 / share / experiment.duration)),
        time=np.asarray(time),
        error=np.asarray(found.value(error)).T,
        effort=np.asarray(found.value(effort)).T,
    )


def _casadi() -> Any:
    """Raises: UsageError: it is not installed."""
    try:
        import casadi
    except ModuleNotFoundError:
        raise UsageError(f"limit needs CasADi: {how_to_install('limit')}") from None
    return casadi


def _step(casadi: Any, arm: Mapping[str, Value], step: float) -> Any:
    """The state (q, q') after a step (s) under a constant effort, by RK4: a function of both."""
    state, effort = casadi.SX.sym("state", 4), casadi.SX.sym("effort", 2)

    def derivative(x: Any) -> Any:
        return casadi.vertcat(x[2:], acceleration(casadi, arm, x[:2], x[2:], effort))

    k1 = derivative(state)
    k2 = derivative(state + 0.5 * step * k1)
    k3 = derivative(state + 0.5 * step * k2)
    k4 = derivative(state + step * k3)
    return casadi.Function("step", [state, effort], [state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])


def acceleration(casadi: Any, arm: Mapping[str, Value], q: Any, dq: Any, effort: Any) -> Any:
    """q'' of the two-link arm, eqs. (48)-(51), as an expression of CasADi.

    Args:
        casadi: the module.
        arm: checked parameters of the simulator.
        q: rad, two values.
        dq: rad/s, likewise.
        effort: N m, likewise.
    """
    m1, m2, r1, r2, j1, j2, g = (as_float(arm[f"robot.{name}"]) for name in ("m1", "m2", "r1", "r2", "j1", "j2", "g"))
    p2, p3, p5, p6 = m2 * r1 * r2, m2 * r2**2, (m1 + m2) * r1 * g, m2 * r2 * g
    p1 = (m1 + m2) * r1**2 + p3 + j1
    h = p2 * casadi.sin(q[1])
    if arm["robot.coriolis"] == "lagrange":
        coriolis = (-h * (2.0 * dq[0] + dq[1]) * dq[1], h * dq[0] ** 2)
    else:
        coriolis = (-h * (dq[0] + 2.0 * dq[1]) * dq[0], h * dq[1] ** 2)
    gravity = (p5 * casadi.cos(q[0]) + p6 * casadi.cos(q[0] + q[1]), p6 * casadi.cos(q[0] + q[1]))
    disturbance: tuple[Any, Any] = (0.0, 0.0)
    if arm["disturbance.name"] == "article":
        disturbance = (
            0.5 * dq[0] + casadi.sin(3.0 * q[0]) + 0.5 * casadi.sin(dq[0]),
            1.3 * dq[1] - 1.8 * casadi.sin(2.0 * q[1]) + 1.1 * casadi.sin(dq[1]),
        )
    net = [effort[j] + disturbance[j] - coriolis[j] - gravity[j] for j in range(2)]
    h11, h12, h22 = p1 + 2.0 * p2 * casadi.cos(q[1]), p3 + p2 * casadi.cos(q[1]), p3 + j2
    determinant = h11 * h22 - h12**2
    return casadi.vertcat((h22 * net[0] - h12 * net[1]) / determinant, (h11 * net[1] - h12 * net[0]) / determinant)
