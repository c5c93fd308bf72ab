"""The linear loop is that of a rollout: both become unstable at the same bandwidth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.loop_margin import Drives, bandwidths, is_stable
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout

STIFFNESS, DAMPING, LAG, RATE = 5000.0, 2.0, 0.001, 500
"""Of all joints: softer, and less damped, than those of any class."""


KNOWN = pytest.mark.parametrize(("observed", "ahead"), [(False, 0), (True, 0), (True, 2)])

LEARNS = {"adaptation.friction": "learn", "compensation.coulomb": [0.02 * each for each in [87.0] * 4 + [12.0] * 3]}
"""As much friction as with which the velocity is corrected fully."""
KNOWS = {
    "estimator.name": "elastic_joint_observer",
    "estimator.stiffness": STIFFNESS,
    "estimator.damping": DAMPING,
    "estimator.rate": float(RATE),
}


def drives(observed: bool = False, ahead: int = 0) -> tuple[Drives, Array]:
    """Of the arm, and its inertia in the middle of the range."""
    values = make_experiment(None, robot="panda").values["simulator"]
    robot = find_robot(values)
    model = robot.pack_model(values)
    joints = len(robot.joints)
    made = Drives(1.0 / RATE, 1, LAG, robot.rotors(model), np.full(joints, STIFFNESS), np.full(joints, DAMPING), True)
    made = replace(made, observed=observed, ahead=ahead)
    return made, robot.inertia_matrix(model, np.array(robot.initial_position))


def growth(bandwidth: float, observed: bool, ahead: int, corrected: bool) -> float:
    """How much a small error of a rollout grows from its first to its second half."""
    experiment = make_experiment(
        None,
        "computed_torque",
        robot="panda",
        overrides={
            "simulator": {
                "rate": RATE,
                "delay.samples": 1,
                "actuator.lag": LAG,
                "elasticity.stiffness": STIFFNESS,
                "elasticity.damping": DAMPING,
                "friction.viscous": 0.0,
            },
            "controller": {
                **(KNOWS if observed else {"estimator.name": "extended_state_observer"}),
                "drive.delay": ahead / RATE,
                "estimator.bandwidth": bandwidth,
                "law.disturbance_rejection": True,
                "law.kp": (0.25 * bandwidth) ** 2,
                "law.kd": 0.5 * bandwidth,
                "compensation.viscous": 0.0,
                **(LEARNS if corrected else {}),
            },
            "trajectory": {"reference.amplitude": 0.0},
        },
    )
    middle = experiment.settings["trajectory"]["reference.offset"]
    begin = {"initial_position": [q + 1e-4 for q in middle]}
    speed = np.abs(rollout(experiment, duration=4.0, simulator=begin).velocity)
    return float(speed[1500:].max() / speed[500:1000].max())


@pytest.mark.parametrize(
    ("observed", "ahead", "corrected", "near"),
    [(False, 0, False, 0.07), (False, 0, True, 0.02), (True, 0, False, 0.07), (True, 2, False, 0.15)],
)
def test_the_bandwidth_at_which_it_becomes_unstable_is_that_of_a_rollout(
    observed: bool, ahead: int, corrected: bool, near: float
) -> None:
    made, inertia = drives(observed, ahead)
    made = replace(made, corrected=corrected)
    critical = brentq(lambda w: 1.0 if is_stable(made, [inertia], np.full(7, w)) else -1.0, 5.0, 500.0, xtol=0.1)
    below, above = (growth(each * critical, observed, ahead, corrected) for each in (1.0 - near, 1.0 + near))
    assert below < 1.0 < above


@KNOWN
def test_those_of_the_rule_are_below_it_and_as_high_as_allowed_where_nothing_resonates(
    observed: bool, ahead: int
) -> None:
    made, inertia = drives(observed, ahead)
    found = bandwidths(made, [inertia], np.full(7, 60.0))
    assert (found <= 60.0).all()
    assert found[0] < 60.0
    assert is_stable(made, [inertia], found)
    slow = np.full(7, 5.0)
    assert (bandwidths(made, [inertia], slow) == slow).all()
