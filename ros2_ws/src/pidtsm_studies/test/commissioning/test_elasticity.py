"""Springs, rotors and lateness are found from the answers of an arm that SciPy simulates."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.elastic_joints import Answer, Believed, Side, answer
from pidtsm_studies.commissioning.elasticity import Explanation, explain
from pidtsm_studies.commissioning.motions import STEP, shaken

LINKS = np.array([[1.2, 0.3], [0.3, 0.4]])
ROTOR, STIFFNESS, RELAXATION = np.array([0.5, 0.15]), np.array([6000.0, 1500.0]), 0.001
EFFORT, VISCOUS = np.array([100.0, 30.0]), 0.3
PERIOD, LATE, NOISE = STEP, 2, 1e-5
BANDS = ((11.0, 17.0), (17.0, 25.0), (25.0, 37.0), (37.0, 56.0))
LOST = 20


def moved(torque: Array, side: Side) -> Array:
    """Positions of two elastic or rigid joints that answer a torque, shape (samples, joints), some samples late."""
    if side is Side.RIGID:
        mass, spring = LINKS + np.diag(ROTOR), np.zeros((2, 2))
        force, seen = np.eye(2), np.eye(2)
    else:
        mass, both = block_diag(np.diag(ROTOR), LINKS), np.array([[1.0, -1.0], [-1.0, 1.0]])
        spring = np.kron(both, np.diag(STIFFNESS))
        force = np.vstack([np.eye(2), np.zeros((2, 2))])
        seen = force.T if side is Side.MOTOR else np.hstack([np.zeros((2, 2)), np.eye(2)])
    count, damping = len(mass), RELAXATION * spring
    damping[:2, :2] += VISCOUS * np.eye(2)
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((count, count)), np.eye(count)], [-inverse @ spring, -inverse @ damping]])
    b = np.vstack([np.zeros((count, 2)), inverse @ force])
    c = np.hstack([seen, np.zeros((2, count))])
    plant = cont2discrete((a, b, c, np.zeros((2, 2))), PERIOD)
    state, positions = np.zeros(2 * count), []
    for k in range(len(torque)):
        positions.append(plant[2] @ state)
        state = plant[0] @ state + plant[1] @ (torque[k - LATE] if k >= LATE else 0.0 * torque[0])
    random = np.random.default_rng(3)
    return np.array(positions) + NOISE * random.normal(size=(len(positions), 2))


def answers(side: Side, links: Array) -> list[Answer]:
    found = []
    for joint in range(2):
        end = np.where(np.arange(2) == joint, 0.7, 0.0)
        for band in BANDS:
            motion, (first, last) = shaken(np.zeros(2), end, 0.5, 0.05 * EFFORT[joint], band, 15.0)
            assert motion.shaking is not None
            time = np.asarray(PERIOD * np.arange(len(motion.shaking)), dtype=np.float64)
            position = motion.states[0] + moved(motion.shaking, side)
            kept = (time >= first) & (time <= last) & (np.arange(time.size) % LOST > 0)
            torque = np.copy(motion.shaking[:, joint])
            found.append(answer(time[kept], position[kept], torque[kept], joint, band, PERIOD, links))
    return found


def best(side: Side, described: Array, links: Array) -> tuple[dict[Side, Explanation], Side]:
    noise = np.full(2, NOISE)
    found = explain(answers(side, links), Believed(described, EFFORT, noise, PERIOD))
    return found, min(found, key=lambda each: found[each].cost)


@pytest.mark.parametrize("described", [ROTOR * [1.2, 0.8], np.zeros(2)], ids=["described", "not described"])
@pytest.mark.parametrize("side", [Side.MOTOR, Side.LINK])
def test_springs_rotors_and_lateness_are_found(side: Side, described: Array) -> None:
    """Although some joint states are lost, and one link is described a fifth too heavy, the other too light."""
    share = np.sqrt([1.2, 0.8])
    found, chosen = best(side, described, LINKS * np.outer(share, share))
    assert chosen is side
    springs = found[side]
    np.testing.assert_allclose(springs.stiffness, STIFFNESS, rtol=0.15)
    # Behind a spring, it is hard to tell rotor and link apart if neither is known.
    known = side is Side.MOTOR or described.all()
    np.testing.assert_allclose(springs.rotor, ROTOR, rtol=0.15 if known else 0.35)
    assert springs.delay == pytest.approx(LATE * PERIOD, abs=0.0005 if known else 0.001)
    for sought, true, half in zip(
        (springs.rotor, springs.stiffness), (ROTOR, STIFFNESS), springs.uncertainty, strict=True
    ):
        assert np.all(np.abs(np.log(sought / true)) < half + 0.05)
    clear = springs.rate < 2.0 * np.pi * BANDS[-1][0]
    assert np.median(np.abs(np.log(springs.explained / springs.measured))[clear]) < 0.1


def test_an_arm_without_springs_is_explained_as_well_without() -> None:
    found, chosen = best(Side.RIGID, ROTOR, LINKS)
    assert found[chosen].cost > 0.9 * found[Side.RIGID].cost
    assert found[Side.RIGID].delay == pytest.approx(LATE * PERIOD, abs=0.0005)
