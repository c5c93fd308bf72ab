"""Measurements of arms whose parameters are known."""

import math
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.identification.carriers import carriers
from pidtsm_core.identification.consistency import body, described_factor
from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.robots import Description, find_description
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.tree.unit_forces import LINK

STEP = 2.0 * math.pi / 2**14


@dataclass(frozen=True)
class KnownArm:
    """A description, parameters pi of the arm that it does not describe exactly, and what was measured of it."""

    described: Description
    truth: Array
    measured: Measurement
    noise: Array


def known_arm(name: str, seed: int = 0, duration: float = 30.0, rate: float = 250.0, step: float = STEP) -> KnownArm:
    """An arm with encoders of 14 bits and noise of the torque.

    Inertias and centres of mass are 20 % off, friction and armature are unknown.
    """
    arm = find_description({"robot.description": name})
    random, centers = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    joints = len(arm.joints)
    limit = np.minimum(arm.effort, 100.0)
    viscous, coulomb, offset = (share * limit * random.uniform(0.5, 1.5, joints) for share in (0.03, 0.05, 0.01))
    truth = described_parameters(arm.tree, viscous, coulomb)
    truth[10 * joints : 11 * joints] = (0.1 + 0.002 * limit) * random.uniform(0.5, 1.5, joints)
    truth[-joints:] = offset
    wrong = described_parameters(arm.tree, np.zeros(joints), np.zeros(joints))
    for j, carrier in enumerate(carriers(arm)[1]):
        part = slice(LINK * j, LINK * (j + 1))
        reshaped = body(described_factor(carrier), 0.1 * random.normal(size=LINK))[0]
        shift = 0.1 * np.linalg.norm(carrier[1:4]) / carrier[0] * centers.normal(size=3)
        wrong[part] += moved(reshaped, np.column_stack([np.eye(3), shift])) - carrier
    time = np.arange(0.0, duration, 1.0 / rate)
    q, dq, ddq = periodic_motion(arm, time, random)
    noise = 0.005 * limit
    effort = regressor(arm.tree, q, dq, ddq) @ truth + noise * random.normal(size=q.shape)
    measured = Measurement(arm.joints, time, step * np.round(q / step), effort, np.full(joints, np.inf))
    return KnownArm(read_description(corrected_urdf(arm, wrong)), truth, measured, noise)


def periodic_motion(arm: Description, time: Array, random: np.random.Generator) -> Array:
    """q, q', q'' of sines within the limits, shape (3, samples, joints)."""
    joints = len(arm.joints)
    bounded = np.isfinite(arm.upper - arm.lower)
    middle = np.where(bounded, 0.5 * (np.where(bounded, arm.upper, 0.0) + np.where(bounded, arm.lower, 0.0)), 0.0)
    size = np.minimum(1.0, 0.4 * np.where(bounded, arm.upper - arm.lower, 3.0))
    result = np.zeros((3, time.size, joints))
    result[0] = middle
    for harmonic in range(1, 6):
        rate = 2.0 * math.pi * 0.1 * harmonic
        amplitude, phase = size * random.uniform(0.1, 0.3, joints), random.uniform(0.0, 2.0 * math.pi, joints)
        angle = rate * time[:, np.newaxis] + phase
        result += amplitude * np.stack([np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle)])
    return result
