"""What the predictive law commands, against SciPy's solution of the same problem."""

import numpy as np
import pytest
import scipy.optimize
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.laws import LAWS, ArmSample, Demand
from pidtsm_core.laws.calls import command_arm, make_law

BANDWIDTH, STEP, BLOCKS = 9.0, 0.03, 5


def cost(v: Array, e: float, de: float) -> float:
    """Of one joint, whose acceleration is v in each block."""
    total, w = 0.0, BANDWIDTH
    for k, each in enumerate(v):
        e, de = e + STEP * de + 0.5 * STEP**2 * each, de + STEP * each
        last = k == BLOCKS - 1
        total += STEP * each**2
        total += (
            2 * w**3 * e**2 + 2 * w**2 * e * de + 2 * w * de**2 if last else STEP * (w**4 * e**2 + 2 * w**2 * de**2)
        )
    return total


def best(arm: Arm, inertia: Array, carried: Array, limits: Array, errors: Array) -> Array:
    """The first accelerations of the plan that SciPy finds."""

    def of_all(v: Array) -> float:
        return sum(cost(own, e, de) for own, e, de in zip(v.reshape(BLOCKS, -1).T, *errors, strict=True))

    def room(v: Array) -> Array:
        efforts = v.reshape(BLOCKS, -1) @ inertia + carried
        return np.concatenate([(limits - efforts) / limits, (limits + efforts) / limits]).ravel()

    found = scipy.optimize.minimize(
        of_all,
        np.zeros(BLOCKS * arm.joints),
        method="SLSQP",
        constraints={"type": "ineq", "fun": room},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success
    return np.asarray(found.x.reshape(BLOCKS, -1)[0])


@pytest.mark.parametrize("room", [1e3, 2.0], ids=["free", "at its limits"])
def test_it_commands_the_best_of_what_the_limits_allow(arm: Arm, room: float) -> None:
    law, n = LAWS["predictive"], arm.joints
    assert law.memory is not None
    made = make_law(law, {"law.bandwidth": BANDWIDTH, "law.step": STEP}, n)
    q, zero = np.array(arm.start), np.zeros(n)
    # Behind, in the direction in which gravity is carried, which leaves the least.
    errors = np.array([-0.1, 0.2])[:, np.newaxis] * np.where(arm.effort(q) < 0.0, -1.0, 1.0)
    inertia = np.array([arm.effort(q, ddq=unit) - arm.effort(q) for unit in np.eye(n)])
    motion = np.array([q, zero, zero])
    desired = np.array([q - errors[0], -errors[1], 0.1 * arm.alternating(1.0)])
    carried = arm.effort(q, ddq=desired[2])
    limits = np.abs(carried) + room * arm.inertia
    memory, demand = np.zeros(law.memory(n)), np.zeros((len(Demand), n))
    tool = made.tree, made.tool_row, made.tool_point
    sample = ArmSample(motion, desired, zero, zero, limits, arm.model, *tool, 1e-3)
    command_arm(made, sample, memory, demand)
    expected = best(arm, inertia, carried, limits, errors)
    np.testing.assert_allclose(
        demand[Demand.ACCELERATION] - desired[2], expected, rtol=0, atol=0.01 * BANDWIDTH**2 * 0.1
    )
    plan = inertia @ (demand[Demand.ACCELERATION] - desired[2]) + carried
    assert (np.abs(plan) <= limits * (1.0 + 1e-4)).all()
    limited = np.abs(demand[Demand.ACCELERATION] - demand[Demand.EQUIVALENT_ACCELERATION]).max()
    assert (limited > 0.1) == (room == 2.0)
