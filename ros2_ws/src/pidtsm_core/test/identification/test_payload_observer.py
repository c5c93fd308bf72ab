"""The payload is estimated while the arm moves, and only then."""

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.identification.payload_observer import PayloadObserver
from pidtsm_core.parameters import resolve
from pidtsm_core.recording import Recording
from pidtsm_core.robots import TreeRobot, find_robot
from pidtsm_core.rollouts.closed_loop import rollout

PICKED_UP = 2.0
ARM = {"robot.description": "ur5"}


@pytest.fixture(scope="module")
def carrying() -> Recording:
    """1 kg is picked up in motion."""
    payload = {"payload.mass": 1.0, "payload.center_of_mass": [0.0, 0.02, 0.05], "payload.time": PICKED_UP}
    faster = {"reference.frequency": 0.25}
    sensors = {"encoder.bits": 14, "delay.samples": 1}
    return rollout(robot="ur5", params="practical", duration=4.5, simulator={**payload, **sensors}, trajectory=faster)


def observed(position: Array, effort: Array) -> tuple[Array, PayloadObserver]:
    """The mass after each sample, and the observer after the last one."""
    robot = find_robot(ARM)
    assert isinstance(robot, TreeRobot)
    observer = PayloadObserver(robot, resolve(controller_schema, ARM, 6), 1e-3)
    masses = np.zeros(len(position))
    for k in range(1, len(position)):
        observer.update(position[k], effort[k - 1])
        masses[k] = observer.payload.mass if k % 50 == 0 else masses[k - 1]
    return masses, observer


def test_a_mass_picked_up_in_motion_is_known_two_seconds_later(carrying: Recording) -> None:
    step = 2.0 * np.pi / 2**14
    masses, observer = observed(step * np.round(carrying.position / step), carrying.effort)
    after = carrying.time > PICKED_UP + 2.0
    np.testing.assert_allclose(masses[after], 1.0, rtol=0.05)
    assert np.abs(masses[(carrying.time > 1.0) & (carrying.time < PICKED_UP)]).max() < 0.05
    assert np.linalg.norm(observer.payload.center_of_mass - [0.0, 0.02, 0.05]) < 0.02
    assert observer.deviation < 0.15


def test_nothing_is_learnt_or_forgotten_at_rest(carrying: Recording) -> None:
    moving = carrying.time.size
    rest = np.repeat(carrying.position[-1:], 2000, axis=0)
    load = np.repeat(carrying.effort[-1:] + 5.0, 2000, axis=0)
    masses, observer = observed(np.vstack([carrying.position, rest]), np.vstack([carrying.effort, load]))
    assert masses[-1] == pytest.approx(masses[moving + 500], rel=1e-12)
    fresh, nothing = observed(rest, load)
    assert (fresh == 0.0).all()
    assert nothing.seen == 0.0
    assert nothing.deviation > 1.0
    assert observer.seen > 1.0
