"""Physically consistent parameters: those of real bodies, nearest to the description, that explain the data."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares, lsq_linear

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import BaseParameters
from pidtsm_core.identification.least_squares import Expectation, Fit
from pidtsm_core.identification.pseudo_inertia import link_parameters, pseudo_inertia
from pidtsm_core.identification.regressor import OF_JOINT
from pidtsm_core.robots.tree.unit_forces import LINK

UNCERTAINTY = 0.15
"""How far real bodies differ from described ones, as standard deviations: 30 % of the mass, of the shape, and of the
distance of the centre of mass from the joint."""
_ROUNDNESS = 0.01
"""m; a body is taken to extend at least so far in all directions: descriptions have points and rods."""
_LIGHTEST = 1e-3
"""kg; smallest mass of a body whose pseudo-inertia is estimated."""
_STUCK = 0.5
"""Cost for each variable from which on the solution is approached: more than one standard deviation."""
_TRIES = 200
"""Steps of SciPy's solver at most."""
_STEPS, _HALVINGS, _SETTLED = 30, 8, 1e-6
"""Of our own: steps at most, halvings of a step at most, and share of the cost by which the last step reduces it."""
_STEP = 10.0
"""Factor by which data that are nearly exact count more from one try to the next."""
_UPPER = np.triu_indices(4)
_CENTER = np.flatnonzero((_UPPER[1] == 3) & (_UPPER[0] < 3))
"""Elements of theta that move the centre of mass."""


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
    """The upper triangle F with pseudo-inertia J = F F' of a described body, as round as `_ROUNDNESS`, shape (4, 4)."""
    mass = max(float(link[0]), _LIGHTEST)
    pseudo = pseudo_inertia(link)
    center = pseudo[:3, 3] / mass
    # An impossible description becomes the possible one next to it.
    values, vectors = np.linalg.eigh(pseudo[:3, :3] - mass * np.outer(center, center))
    spread = (vectors * np.maximum(values, mass * _ROUNDNESS**2)) @ vectors.T
    factor = np.zeros((4, 4))
    factor[:3, :3] = np.linalg.cholesky(spread[::-1, ::-1])[::-1, ::-1]
    factor[:, 3] = np.sqrt(mass) * np.array([*center, 1.0])
    return factor


def body(factor: Array, theta: Array) -> tuple[Array, Array]:
    """Ten parameters of a body, shape (10,), and their derivatives by theta, shape (10, 10).

    Log-Cholesky coordinates (Rucker and Wensing, IEEE RA-L 7, 2022) relative to the described body: J = F U U' F' with
    an upper triangle U whose diagonal is exp(theta), so that theta = 0 is the description, whatever its size. The last
    column of U is mass and centre of mass, the rest is the shape.
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


def _uncertainty(factor: Array) -> Array:
    """A root of the covariance of theta of a described body, shape (10, 10).

    Coordinates of the centre are relative to the size of the body; of a small one far from the joint they are the
    more uncertain.
    """
    root = np.eye(LINK)
    size, center = factor[:3, :3], factor[:3, 3]
    relative = np.linalg.norm(center) * np.linalg.inv(size)
    root[np.ix_(_CENTER, _CENTER)] = np.linalg.cholesky(np.eye(3) + relative @ relative.T)
    return UNCERTAINTY * root


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
        certainty = [np.linalg.inv(_uncertainty(factor)) for factor in self._factors]
        self._certainty = block_diag(*certainty, np.eye(len(OF_JOINT) * joints))
        self._rest = prior.parameters[: self._links] - prior.carriers.ravel()
        self._described = np.concatenate([np.zeros(self._links), prior.parameters[self._links :] / prior.deviation])
        self._target = fit.factor @ fit.beta
        # Offsets may have either sign.
        least = np.zeros(len(OF_JOINT) * joints)
        least[-joints:] = -np.inf
        self.bounds = np.concatenate([np.full(self._links, -np.inf), least]), np.inf

    @property
    def start(self) -> Array:
        """The description, strictly within the bounds."""
        of_joints = np.arange(self._described.size) >= self._links
        return np.where(of_joints & (self._described == 0.0), 1e-3, self._described)

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

    def residuals(self, variables: Array, weight: float = 1.0) -> Array:
        """In standard deviations: of the data, times the weight that they have, then of the description."""
        data = weight * (self._mapping @ self.parameters(variables)[0] - self._target)
        return np.concatenate([data, self._certainty @ (variables - self._described)])

    def cost(self, variables: Array, weight: float = 1.0) -> float:
        """Half the sum of squares of `residuals`."""
        return 0.5 * float(np.sum(self.residuals(variables, weight) ** 2))

    def slopes(self, variables: Array, weight: float = 1.0) -> Array:
        """Derivatives of `residuals`."""
        return np.vstack([weight * (self._mapping @ self.parameters(variables)[1]), self._certainty])


def consistent_parameters(
    prior: Prior, base: BaseParameters, fit: Fit, preferred: Array | None = None
) -> tuple[Array, float]:
    """The parameters pi of possible bodies that are nearest to data and description, shape (14 joints,).

    Each is weighted with its uncertainty, so the data decide wherever they say more than the description, and along
    directions about which they say nothing, the description stays. The second result is how far they are from
    both, as a mean in standard deviations; about 1 at most if data and description are of the same arm.

    Args:
        prior: what the description says.
        base: the combinations that the data can say something about.
        fit: what they say.
        preferred: standard deviations that take the place of `prior.deviation` where the data do not decide; the
            distance does not count them. Shape (4 joints,).
    """
    problem = _Problem(prior if preferred is None else replace(prior, deviation=preferred), base, fit)
    variables, links = _nearest(problem), prior.carriers.size
    parameters = problem.parameters(variables)[0]
    variables[links:] = parameters[links:] / prior.deviation
    distance = np.linalg.norm(_Problem(prior, base, fit).residuals(variables)) / np.sqrt(variables.size)
    return parameters, float(distance)


def _nearest(problem: _Problem) -> Array:
    """The variables of the solution.

    Dogbox takes a fifth of the steps of SciPy's default method, and needs no singular values, which were once not found
    near bounds. But it may end at a bound that it should leave, or in a narrow valley if the data are nearly exact,
    both far from data and description. Then the solution is approached.
    """
    found = least_squares(
        problem.residuals,
        problem.start,
        jac=problem.slopes,
        bounds=problem.bounds,
        method="dogbox",
        x_scale="jac",
        max_nfev=_TRIES,
    )
    if found.cost <= _STUCK * found.x.size:
        return np.asarray(found.x)
    return min(np.asarray(found.x), _approached(problem), key=problem.cost)


def _approached(problem: _Problem) -> Array:
    """The solution, from those of problems in which the data count less."""
    found = problem.start
    far = max(1.0, math.sqrt(2.0 * problem.cost(found) / found.size))
    for weight in np.geomspace(1.0 / far, 1.0, 2 + round(math.log(far, _STEP))):
        found = _solved(problem, found, float(weight))
    return found


def _solved(problem: _Problem, start: Array, weight: float) -> Array:
    """The solution next to a start: Gauss and Newton's method, each step of which keeps the bounds."""
    found, cost = start, problem.cost(start, weight)
    for _ in range(_STEPS):
        lower = problem.bounds[0] - found
        matrix, residuals = problem.slopes(found, weight), problem.residuals(found, weight)
        step = lsq_linear(matrix, -residuals, (lower, np.inf), method="bvls").x
        shorter = (found + 0.5**halvings * step for halvings in range(_HALVINGS))
        better = next((each for each in shorter if problem.cost(each, weight) < cost), None)
        if better is None:
            break
        before, found, cost = cost, better, problem.cost(better, weight)
        if before - cost < _SETTLED * before:
            break
    return found


def expectation(prior: Prior, base: BaseParameters) -> Expectation:
    """The base parameters of the description, and how uncertain they are."""
    joints = len(prior.carriers)
    spread = np.zeros((prior.parameters.size, prior.parameters.size))
    for j, carrier in enumerate(prior.carriers):
        part = slice(LINK * j, LINK * (j + 1))
        factor = described_factor(carrier)
        spread[part, part] = body(factor, np.zeros(LINK))[1] @ _uncertainty(factor)
    rest = np.arange(LINK * joints, prior.parameters.size)
    spread[rest, rest] = prior.deviation
    return Expectation(base.mapping @ prior.parameters, np.linalg.norm(base.mapping @ spread, axis=1))
