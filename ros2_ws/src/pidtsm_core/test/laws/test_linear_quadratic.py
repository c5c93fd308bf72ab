"""The gains of each posture against SciPy's solution of the Riccati equation."""

import numpy as np
import pytest
import scipy.linalg
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.laws import LAWS, ArmSample, Demand
from pidtsm_core.laws.calls import command_arm, make_law

BANDWIDTH, WEIGHTS = 12.0, {"integral": 0.7, "position": 1.3, "velocity": 0.4}


def riccati(inertia: Array, attenuation: float) -> Array:
    """Gains of [int e, e, e'], shape (joints, 3 joints), for the cost and the bound of the module."""
    n, diagonal = len(inertia), np.diag(inertia)
    zero, one = np.zeros((n, n)), np.eye(n)
    dynamics = np.block([[zero, one, zero], [zero, zero, one], [zero, zero, zero]])
    push = np.vstack([zero, zero, np.linalg.inv(inertia)])
    w, of = BANDWIDTH, WEIGHTS
    shares = of["integral"] * w**6, 3.0 * of["position"] * w**4, 3.0 * of["velocity"] * w**2
    cost = scipy.linalg.block_diag(*(share * np.diag(diagonal) for share in shares))
    effort = np.diag(1.0 / diagonal)
    # A disturbance acts as u does, and its energy is measured as that of u.
    bound = effort / (1.0 - attenuation**-2)
    solution = scipy.linalg.solve_continuous_are(dynamics, push, cost, bound)
    return np.asarray(np.linalg.inv(effort) @ push.T @ solution)


@pytest.mark.parametrize("attenuation", [1e6, 1.5], ids=["linear-quadratic", "H-infinity"])
def test_gains_solve_the_riccati_equation_of_the_posture(arm: Arm, attenuation: float) -> None:
    values = {
        "law.bandwidth": BANDWIDTH,
        **{f"law.{name}_weight": weight for name, weight in WEIGHTS.items()},
        "law.attenuation": attenuation,
    }
    law = LAWS["linear_quadratic"]
    assert law.memory is not None
    made, n = make_law(law, values, arm.joints), arm.joints
    random, q = np.random.default_rng(n), np.array(arm.start)
    integral, e, de = random.normal(size=(3, n))
    memory, demand = np.zeros(law.memory(n)), np.zeros((len(Demand), n))
    memory[:n] = integral
    desired = np.array([q - e, -de, random.normal(size=n)])
    zero = np.zeros(n)
    tool = made.tree, made.tool_row, made.tool_point
    sample = ArmSample(np.array([q, zero, zero]), desired, zero, zero, arm.limits, arm.model, *tool, 1e-3)
    command_arm(made, sample, memory, demand)
    inertia = np.array([arm.effort(q, ddq=unit) - arm.effort(q) for unit in np.eye(n)])
    expected = -riccati(0.5 * (inertia + inertia.T), attenuation) @ np.concatenate([integral, e, de])
    np.testing.assert_allclose(demand[Demand.EFFORT], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(demand[Demand.ACCELERATION], desired[2])
