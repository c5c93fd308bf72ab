"""How well a model explains the efforts of a motion, and which change of the model explains them better.

Position and effort pass the same low-pass, so that the equation of motion holds between them. Efforts are linear in
masses, first moments and inertias of the links (`regressor`); friction, rotor and offset of each joint are always
fitted along, because no description knows them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import base_parameters
from pidtsm_core.identification.data_faults import limited
from pidtsm_core.identification.measurement import Measurement, Motion, Piece, filtered, joined
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.robots.tree.unit_forces import LINK
from pidtsm_studies.diagnosis.loop import Loop

_CUTOFF, _CUTOFF_OF_SHORT, _SHORT = 3.0, 24.0, 8.0
"""Hz, bandwidth of the low-pass; that for shorter recordings, times seconds; and seconds of these."""
_SHORTEST_STOP = 0.1
"""s of a recording of a stop."""
_FEWEST = 12
"""Usable samples of a joint that counts."""
_SLOW = 0.02
"""rad/s or m/s; slower samples of a joint do not count: their friction does not follow from the velocity."""
_OF_LIMIT = 0.03
"""Part of the effort limit that is added to the RMS of an effort as its size: of less, nothing matters."""
_OFFSET = 0.02
"""Standard deviation of the offset of an effort, as a share of its limit."""
_POINT = 4
"""Parameters of a point mass among those of a link: mass and first moments."""
_PAYLOAD = np.array([10.0, 0.3, 0.3, 0.3])
"""kg and kg m: standard deviations of mass and first moments of what an arm may carry."""
_NOISE = 0.02
"""Share of its size to which an effort is known, for the weight of what free parameters may be."""
_MASS, _FIRST, _INERTIA = 0.25, 0.05, 0.015
"""Standard deviations of what a description may have wrong of a link, relative to its mass: its mass itself, its first
moments (m), and its inertias (m^2)."""
_WEAK = 0.5
"""Standard deviation of what each parameter of the links adds, relative to the size of the effort."""
_LARGEST_FRICTION = 1.0
"""Standard deviation of what each column of friction contributes, relative to the size of the effort."""
_FRICTION = 5
"""Columns of friction, see `_friction_columns`."""
_BETTER = 0.6
"""Share of the unexplained effort that may remain with another structure."""


@dataclass(frozen=True)
class Change:
    """Another structure: the joints whose sign is wrong, or two that are exchanged."""

    kind: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class ModelFit:
    """Shares of the efforts (RMS of all joints, relative to their size) that models leave unexplained.

    Attributes:
        described: by the description.
        worst: the same of the joint with the largest share.
        payload: with a point mass at the tool.
        scaled: with all masses and inertias so many times those of the description.
        bodies: with any masses, centres and inertias in the geometry of the description.
        near: with masses, centres and inertias not too far from those described: another geometry needs others.
        mass: of that point mass, kg.
        center: of it, in the frame of the tool, m, shape (3,).
        changes: other structures that explain clearly more, one after the other.
        restructured: share that is left with them.
        time, effort, residual: what the description leaves, s, shape (samples,), and N m or N, (samples, joints).
        shares: by joint, of the description, shape (joints,).
    """

    described: float
    worst: float
    payload: float
    scaled: float
    bodies: float
    near: float
    mass: float
    center: Array
    changes: tuple[Change, ...]
    restructured: float
    time: Array
    effort: Array
    residual: Array
    shares: Array


class TooLittleMotionError(ValueError):
    """A recording with too little motion to judge a model."""


def fit_models(arm: Description, loop: Loop, violent: bool = False) -> ModelFit:
    """Compare models with a recording.

    Args:
        arm: what the controller believes, with the payload that it knows.
        loop: has the joints of the arm, in its order.
        violent: whether it is a stop, which is short; its efforts count also where they are at their limits.

    Raises:
        TooLittleMotionError: nothing can be said.
    """
    # The systems are small: several threads of BLAS would wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        pieces = _pieces(arm, loop, violent)
        motion, time = joined([piece.motion for piece in pieces]), np.concatenate([piece.time for piece in pieces])
        usable = np.concatenate([piece.usable for piece in pieces])
        if violent:  # A joint at its end is held there by more than its drive.
            usable &= (motion.position > arm.lower) & (motion.position < arm.upper)
        usable &= np.count_nonzero(usable, axis=0) >= _FEWEST
        if not usable.any():
            raise TooLittleMotionError("too little motion without gaps")
        problem = _Problem(arm, motion, usable)
        payload, point = problem.unexplained(_point_columns(arm, problem.full), _PAYLOAD)
        changes, restructured = _changes(arm, motion, usable)
        mass = float(point[0])
        return ModelFit(
            described=_total(problem.shares),
            worst=float(problem.shares.max()),
            payload=payload,
            scaled=problem.unexplained(problem.all_links(), np.ones(1))[0],
            bodies=problem.unexplained(*problem.link_columns())[0],
            near=problem.unexplained(problem.full[..., : problem.links], problem.errors_of_links())[0],
            mass=mass,
            center=point[1:] / mass if mass else np.zeros(3),
            changes=changes,
            restructured=restructured,
            time=time,
            effort=motion.effort,
            residual=problem.left,
            shares=problem.shares,
        )


def _pieces(arm: Description, loop: Loop, violent: bool) -> list[Piece]:
    """The recording, filtered; of a stop also what is short or at the limit of a drive.

    Raises:
        TooLittleMotionError: it is too short.
    """
    unlimited = np.full(len(arm.joints), np.inf)
    measured = Measurement(arm.joints, loop.time, loop.position, loop.effort, unlimited, _SLOW)
    measured = replace(measured, shortest=_SHORTEST_STOP) if violent else limited(measured, arm.effort)
    cutoff = _CUTOFF if loop.duration > _SHORT else _CUTOFF_OF_SHORT / loop.duration
    pieces = filtered(measured, min(cutoff, 0.1 / measured.period))
    if not pieces:
        raise TooLittleMotionError(f"{loop.duration:.2g} s are too short to judge the model")
    return pieces


class _Problem:
    """The efforts that the description leaves, friction, and what else may explain them."""

    def __init__(self, arm: Description, motion: Motion, usable: NDArray[np.bool_]) -> None:
        self._arm, self._usable = arm, usable
        self._joints = len(arm.joints)
        self.links = LINK * self._joints
        self.full = regressor(arm.tree, motion.position, motion.velocity, motion.acceleration)
        known = described_parameters(arm.tree, 0.0 * arm.damping, 0.0 * arm.friction)
        self._rest = motion.effort - self.full[..., : self.links] @ known[: self.links]
        self._limit = np.where(np.isfinite(arm.effort), arm.effort, np.abs(motion.effort).max(axis=0) + 1e-9)
        self._size = _rms(motion.effort, usable) + _OF_LIMIT * self._limit
        self._friction = _friction_columns(motion)

    @cached_property
    def left(self) -> Array:
        """What friction, rotor and offset do not explain of what the description leaves, shape (samples, joints)."""
        left = np.zeros_like(self._rest)
        for j in range(self._joints):
            rows = self._usable[:, j]
            if rows.any():
                columns = self._friction[:, j]
                found = _friction_of(columns[rows], self._rest[rows, j], self._size[j], self._limit[j])
                left[:, j] = self._rest[:, j] - np.column_stack([columns, np.ones(len(columns))]) @ found
        return left

    @cached_property
    def shares(self) -> Array:
        """RMS of `left`, relative to the size of the efforts, shape (joints,)."""
        return _rms(self.left, self._usable) / self._size

    def link_columns(self) -> tuple[Array, Array]:
        """Columns of the base parameters of the links, and how large they may be."""
        base = base_parameters(self._arm.tree, self._joints, np.arange(self.links))
        columns = self.full[..., base.columns]
        size = np.sqrt(np.mean((columns / self._size[:, np.newaxis]) ** 2, axis=(0, 1))) + 1e-12
        return columns, _WEAK / size

    def errors_of_links(self) -> Array:
        """Standard deviations of what the description may have wrong of each parameter of the links."""
        mass = described_parameters(self._arm.tree, 0.0 * self._limit, 0.0 * self._limit)[: self.links : LINK]
        return np.outer(mass, [_MASS, *[_FIRST] * 3, *[_INERTIA] * 6]).ravel() + 1e-9

    def all_links(self) -> Array:
        """The efforts of the whole arm as one column, shape (samples, joints, 1)."""
        known = described_parameters(self._arm.tree, 0.0 * self._limit, 0.0 * self._limit)
        return np.asarray((self.full[..., : self.links] @ known[: self.links])[..., np.newaxis])

    def unexplained(self, columns: Array, deviation: Array) -> tuple[float, Array]:
        """Share that is left with free parameters of some columns, and these parameters.

        Args:
            columns: shape (samples, joints, parameters).
            deviation: standard deviation of each parameter, shape (parameters,).
        """
        count, usable = columns.shape[2], self._usable
        table = np.concatenate([columns, self._apart()], axis=2) / self._size[:, np.newaxis]
        target = self._rest / self._size
        extent = np.sqrt(np.mean(table[usable][:, count:] ** 2, axis=0) * self._joints) + 1e-9
        apart = _LARGEST_FRICTION / extent
        apart[_FRICTION :: _FRICTION + 1] = _OFFSET * self._limit
        weight = _NOISE * np.sqrt(np.count_nonzero(usable) / self._joints)
        system = np.vstack([table[usable], np.diag(weight / np.concatenate([deviation, apart]))])
        values = np.concatenate([target[usable], np.zeros(count + apart.size)])
        found = np.linalg.lstsq(system, values, rcond=None)[0]
        left = target - table @ found
        return _total(_rms(left, usable)), found[:count]

    def _apart(self) -> Array:
        """Friction and offset of every joint as columns of all joints, shape (samples, joints, joints columns)."""
        each = _FRICTION + 1
        columns = np.zeros((len(self._rest), self._joints, each * self._joints))
        for j in range(self._joints):
            columns[:, j, each * j : each * j + _FRICTION] = self._friction[:, j]
            columns[:, j, each * j + _FRICTION] = 1.0
        return columns


def _friction_columns(motion: Motion) -> Array:
    """Rotor, viscous and Coulomb friction, its part that grows with the load, and Stribeck's, (samples, joints, 5)."""
    slow = np.exp(-((motion.velocity / 0.05) ** 2))
    dry = motion.coulomb
    return np.stack([motion.acceleration, motion.velocity, dry, dry * np.abs(motion.effort), dry * slow], axis=2)


def _friction_of(columns: Array, rest: Array, size: float, limit: float) -> Array:
    """Parameters of friction, none negative, and of the offset, which is small, shape (6,)."""
    ones = np.ones((len(columns), 1))
    weight = _NOISE * size * np.sqrt(len(columns)) / (_OFFSET * limit)
    system = np.vstack([np.hstack([columns, ones, -ones]), [0.0] * _FRICTION + [weight, -weight]])
    found = nnls(system, np.append(rest, 0.0))[0]
    return np.append(found[:_FRICTION], found[-2] - found[-1])


def _rms(values: Array, usable: NDArray[np.bool_]) -> Array:
    """Root mean square of the usable samples of each joint, 0 where there is none, shape (joints,)."""
    count = np.maximum(np.count_nonzero(usable, axis=0), 1)
    return np.asarray(np.sqrt(np.sum(values**2, axis=0, where=usable) / count))


def _total(shares: Array) -> float:
    """Root mean square of the shares of all joints that count."""
    counted = shares[shares > 0.0]
    return float(np.sqrt(np.mean(counted**2))) if counted.size else 0.0


def _point_columns(arm: Description, full: Array) -> Array:
    """Columns of mass and first moments of a point mass in the frame of the tool, shape (samples, joints, 4)."""
    first = LINK * int(rows(arm.tree)[arm.tool_row, Column.PLACE])
    placement = np.column_stack([arm.tool_rotation, arm.tool])
    of_tool = np.array([moved(unit, placement) for unit in np.eye(LINK)[:_POINT]]).T
    return np.asarray(full[..., first : first + LINK] @ of_tool)


def _changes(arm: Description, motion: Motion, usable: NDArray[np.bool_]) -> tuple[tuple[Change, ...], float]:
    """Other structures that explain clearly more, each after the one before, and the share that is left."""
    found: list[Change] = []
    left = _total(_Problem(arm, motion, usable).shares)
    for _ in arm.joints:
        every = _structures(arm, motion, usable)
        tried = [(_total(_Problem(arm, *data).shares), change, data) for change, data in every]
        share, change, data = min(tried, key=lambda each: each[0])
        if share > _BETTER * left:
            break
        found, left = [*found, change], share
        motion, usable = data
    return tuple(found), left


def _structures(
    arm: Description, motion: Motion, usable: NDArray[np.bool_]
) -> Iterator[tuple[Change, tuple[Motion, NDArray[np.bool_]]]]:
    """Each structure that is tried, with the motion as it would be."""
    for i, k in combinations(range(len(arm.joints)), 2):
        order = np.arange(len(arm.joints))
        order[[i, k]] = k, i
        swapped = Motion(*(column[:, order] for column in vars(motion).values()))
        yield Change("order", (arm.joints[i], arm.joints[k])), (swapped, usable[:, order])
    efforts = ("effort", "effort_rate")
    for j, joint in enumerate(arm.joints):
        for kind in ("axis", "effort", "position"):
            changed = {}
            for name, column in vars(motion).items():
                flips = kind == "axis" or (name in efforts) == (kind == "effort")
                changed[name] = column * np.where(np.arange(len(arm.joints)) == j, -1.0, 1.0) if flips else column
            yield Change(kind, (joint,)), (Motion(**changed), usable)
