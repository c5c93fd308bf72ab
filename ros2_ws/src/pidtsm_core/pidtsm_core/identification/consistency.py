"""Physically consistent parameters: those of real bodies, nearest to the description, that explain the data."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pidtsm_core.identification.base_parameters import BaseParameters
from pidtsm_core.identification.least_squares import Expectation, Fit
from pidtsm_core.identification.pseudo_inertia import link_parameters, pseudo_inertia
from pidtsm_core.identification.regressor import LINK, OF_JOINT
from pidtsm_core.parameters import Array

UNCERTAINTY = 0.15
"""How far real bodies differ from described ones: 30 % of mass and inertia, as a standard deviation of theta."""
_ROUNDNESS = 0.01
"""m; a body is taken to extend at least so far in all directions: descriptions have points and rods."""
_LIGHTEST = 1e-3
"""kg; smallest mass of a body whose pseudo-inertia is estimated."""
_UPPER = np.triu_indices(4)


@dataclass(frozen=True)
class Prior:
    """What the description of an arm says, and how uncertain it is.

    Attributes:
        parameters: pi, see `regressor`, shape (14 joints,).
        carriers: of each link, the part of its ten parameters that belongs to the body whose inertia is estimated,
            shape (joints, 10); the rest of the link, such as a gripper, is kept.
        deviation: standard deviation of the parameters of the joints, shape (4 joints,).
    """

    parameters: Array
    carriers: Array
    deviation: Array


def described_factor(link: Array) -> Array:
    """A factor L of the pseudo-inertia J = L L' of a described body, made as round as `_ROUNDNESS`, shape (4, 4)."""
    mass = max(float(link[0]), _LIGHTEST)
    pseudo = pseudo_inertia(link)
    pseudo[3, 3] = mass
    pseudo[:3, :3] += mass * _ROUNDNESS**2 * np.eye(3)
    values, vectors = np.linalg.eigh(pseudo)
    # An impossible description becomes the possible one next to it.
    return np.linalg.cholesky((vectors * np.maximum(values, mass * 1e-6)) @ vectors.T)


def body(factor: Array, theta: Array) -> tuple[Array, Array]:
    """Ten parameters of a body, shape (10,), and their derivatives by theta, shape (10, 10).

    Log-Cholesky coordinates (Rucker and Wensing, IEEE RA-L 7, 2022) relative to the described body: J = L U U' L' with
    an upper triangle U whose diagonal is exp(theta), so that theta = 0 is the description, whatever its size.
    """
    upper = np.zeros((4, 4))
    upper[_UPPER] = theta
    diagonal = np.exp(np.diag(upper))
    np.fill_diagonal(upper, diagonal)
    slopes = np.zeros((theta.size, 4, 4))
    for k, (i, j) in enumerate(zip(*_UPPER, strict=True)):
        slopes[k, i, j] = diagonal[i] if i == j else 1.0
    scaled = factor @ upper
    changes = factor @ slopes @ scaled.T
    return (
        link_parameters(scaled @ scaled.T),
        link_parameters(changes + changes.swapaxes(1, 2)).T,
    )


class _Problem:
    """Data and description as one problem of least squares.

    The variables are theta of all links, then the parameters of the joints divided by their deviations.
    """

    def __init__(self, prior: Prior, base: BaseParameters, fit: Fit) -> None:
        self._prior, self._fit = prior, fit
        self._mapping = fit.factor @ base.mapping
        joints = len(prior.carriers)
        self._links = LINK * joints
        self._factors = [described_factor(carrier) for carrier in prior.carriers]
        self._rest = prior.parameters[: self._links] - prior.carriers.ravel()
        self._centre = prior.parameters[self._links :] / prior.deviation
        self._target = fit.factor @ fit.beta
        # Offsets may have either sign.
        least = np.zeros(len(OF_JOINT) * joints)
        least[-joints:] = -np.inf
        self.bounds = np.concatenate([np.full(self._links, -np.inf), least]), np.inf

    @property
    def start(self) -> Array:
        """The description, strictly within the bounds."""
        return np.concatenate([np.zeros(self._links), np.where(self._centre == 0.0, 1e-3, self._centre)])

    def parameters(self, variables: Array) -> tuple[Array, Array]:
        """The vector pi, and its derivatives by the variables."""
        values, slopes = np.empty(variables.size), np.zeros((variables.size, variables.size))
        for j, factor in enumerate(self._factors):
            part = slice(LINK * j, LINK * (j + 1))
            values[part], slopes[part, part] = body(factor, variables[part])
        values[: self._links] += self._rest
        values[self._links :] = self._prior.deviation * variables[self._links :]
        of_joints = np.arange(self._links, variables.size)
        slopes[of_joints, of_joints] = self._prior.deviation
        return values, slopes

    def residuals(self, variables: Array) -> Array:
        """In standard deviations: of the data, then of the description."""
        data = self._mapping @ self.parameters(variables)[0] - self._target
        theta, of_joints = np.split(variables, [self._links])
        return np.concatenate([data, theta / UNCERTAINTY, of_joints - self._centre])

    def slopes(self, variables: Array) -> Array:
        """Derivatives of `residuals`."""
        scale = np.where(np.arange(variables.size) < self._links, 1.0 / UNCERTAINTY, 1.0)
        return np.vstack([self._mapping @ self.parameters(variables)[1], np.diag(scale)])


def consistent_parameters(prior: Prior, base: BaseParameters, fit: Fit) -> tuple[Array, float]:
    """The parameters pi of possible bodies that are nearest to data and description, shape (14 joints,).

    Each is weighted with its uncertainty, so the data decide wherever they say more than the description, and along
    directions about which they say nothing, the description stays. The second result is how far they are from
    both, as a mean in standard deviations; about 1 at most if data and description are of the same arm.
    """
    problem = _Problem(prior, base, fit)
    found = least_squares(
        problem.residuals, problem.start, jac=problem.slopes, bounds=problem.bounds, x_scale="jac", max_nfev=200
    )
    return problem.parameters(found.x)[0], float(np.sqrt(2.0 * found.cost / found.x.size))


def expectation(prior: Prior, base: BaseParameters) -> Expectation:
    """The base parameters of the description, and how uncertain they are."""
    joints = len(prior.carriers)
    spread = np.zeros((prior.parameters.size, prior.parameters.size))
    for j, carrier in enumerate(prior.carriers):
        part = slice(LINK * j, LINK * (j + 1))
        spread[part, part] = UNCERTAINTY * body(described_factor(carrier), np.zeros(LINK))[1]
    rest = np.arange(LINK * joints, prior.parameters.size)
    spread[rest, rest] = prior.deviation
    return Expectation(base.mapping @ prior.parameters, np.linalg.norm(base.mapping @ spread, axis=1))
