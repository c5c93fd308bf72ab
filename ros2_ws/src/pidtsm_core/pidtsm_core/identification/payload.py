"""What an arm carries, from a measurement of its motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import base_parameters
from pidtsm_core.identification.carriers import mass_and_center
from pidtsm_core.identification.consistency import body
from pidtsm_core.identification.data_faults import limited, recording_faults
from pidtsm_core.identification.identification import IdentificationError
from pidtsm_core.identification.least_squares import CONFIDENCE, Expectation, Fit, fit
from pidtsm_core.identification.measurement import Measurement, bandwidth
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.identification.regressor import described_parameters
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.robots.tree.unit_forces import LINK

_RADIUS, _MASS = 0.05, 1.0
"""m, kg: the ball at the tool that is taken to be the payload until data show something else."""
_VAGUENESS = 2.0
"""Standard deviation of theta of that ball, see `consistency.body`: its mass may be 50 times more or less."""
_STEP = 1e-5
"""Of theta, for derivatives."""
_OFFSET = 0.05
"""Standard deviation of an offset of the torque, as a share of the effort limit."""


@dataclass(frozen=True)
class CarriedBody:
    """A payload with intervals of 95 % in each number, in the tool frame.

    Attributes:
        mass: kg.
        center_of_mass: m, shape (3,).
        inertia: about the centre of mass: xx, yy, zz, xy, xz, yz, kg m^2, shape (6,).
        mass_interval, center_interval, inertia_interval: half the widths of the intervals; wide where the motion, or
            any motion of this arm, does not show the number.
        warnings: sentences.
    """

    mass: float
    center_of_mass: Array
    inertia: Array
    mass_interval: float
    center_interval: Array
    inertia_interval: Array
    warnings: tuple[str, ...]


def identify_payload(arm: Description, measurement: Measurement) -> CarriedBody:
    """Identify what an arm carries.

    The torques of the description, which should be an identified one, with friction, are subtracted; the rest is that
    of a body at the tool, and of offsets of the joints.

    Args:
        arm: description of the arm without payload.
        measurement: ten seconds of motion are enough; has the joints of the arm, in any order.

    Raises:
        IdentificationError: the measurement cannot be used.
    """
    if missing := [joint for joint in arm.joints if joint not in measurement.joints]:
        raise IdentificationError(f"the joint states lack {', '.join(missing)}: is this the bag of another robot?")
    measured = limited(measurement.of(arm.joints), arm.effort)
    faults = list(recording_faults(measured))
    if fatal := [fault.text for fault in faults if fault.fatal]:
        raise IdentificationError("\n".join(fatal))
    joints = len(arm.joints)
    link = LINK * int(rows(arm.tree)[arm.tool_row, Column.PLACE])
    offsets = np.arange(-joints, 0) + 14 * joints
    base = base_parameters(arm.tree, joints, np.array([*range(link, link + LINK), *offsets]))
    known = described_parameters(arm.tree, arm.damping, arm.friction)
    limit = np.where(np.isfinite(arm.effort), arm.effort, np.abs(measured.effort).max(axis=0))
    is_offset = base.columns >= offsets[0]
    deviation = np.ones(base.columns.size)
    deviation[is_offset] = _OFFSET * limit[base.columns[is_offset] - offsets[0]]
    expected = Expectation(np.zeros(base.columns.size), deviation)
    try:
        with threadpool_limits(limits=1, user_api="blas"):  # See `identify`.
            found = fit(arm.tree, base, [measured], bandwidth([measured]), expected, known)
    except ValueError as error:
        raise IdentificationError(str(error)) from None
    return _body(arm, base.mapping[:, [*range(link, link + LINK), *offsets]], found, [f.text for f in faults])


def _body(arm: Description, mapping: Array, found: Fit, warnings: list[str]) -> CarriedBody:
    """The possible body that explains the estimates; mapping, shape (base, 10 + joints), leads to them."""
    placement = np.column_stack([arm.tool_rotation, arm.tool])
    factor = np.diag([_RADIUS, _RADIUS, _RADIUS, 1.0]) * np.sqrt(_MASS)
    weighted, target = found.factor @ mapping, found.factor @ found.beta

    def residuals(variables: Array) -> Array:
        link = moved(body(factor, variables[:LINK])[0], placement)
        data = weighted @ np.concatenate([link, variables[LINK:]]) - target
        return np.concatenate([data, variables[:LINK] / _VAGUENESS])

    solution = least_squares(residuals, np.zeros(mapping.shape[1]), method="dogbox", x_scale="jac", max_nfev=50)
    covariance = np.linalg.inv(solution.jac.T @ solution.jac)[:LINK, :LINK]
    theta = solution.x[:LINK]
    slopes = np.array(
        [
            (_numbers(factor, theta + step) - _numbers(factor, theta - step)) / (2.0 * _STEP)
            for step in _STEP * np.eye(LINK)
        ]
    )
    half = norm.ppf(0.5 + 0.5 * CONFIDENCE) * np.sqrt(np.einsum("ik,ij,jk->k", slopes, covariance, slopes))
    numbers = _numbers(factor, theta)
    if half[0] > 0.5 * numbers[0]:
        warnings.append("the motion does not show the mass: move the joints that lift the payload")
    return CarriedBody(
        float(numbers[0]), numbers[1:4], numbers[4:], float(half[0]), half[1:4], half[4:], tuple(warnings)
    )


def _numbers(factor: Array, theta: Array) -> Array:
    """Mass, centre of mass, and inertia about it of a body, shape (10,)."""
    mass, center, about = mass_and_center(body(factor, theta)[0])
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = about
    return np.array([mass, *center, xx, yy, zz, xy, xz, yz])


def as_parameters(carried: CarriedBody) -> dict[str, Any]:
    """Parameters of the group ``payload`` of controller and simulator."""
    return {
        "payload.mass": carried.mass,
        "payload.center_of_mass": tuple(carried.center_of_mass.tolist()),
        "payload.inertia": tuple(carried.inertia.tolist()),
    }
