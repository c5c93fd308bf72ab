"""A payload estimated while the arm moves: recursive least squares, sample by sample.

Positions and efforts pass the same causal low-pass, so that both sides of the equation of motion are late by the same
time, and derivatives of the filtered position follow from the states of the filter. What the model without payload does
not explain is that of a point mass at the tool. Samples in which a joint sticks do not count; while nothing moves,
nothing is learnt and nothing forgotten.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.identification.regressor import REVERSAL, described_parameters, regressor
from pidtsm_core.parameters import Value, joint_array
from pidtsm_core.robots import TreeRobot
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.robots.tree.unit_forces import LINK

_STAGES = 4
"""First-order low-passes in a row."""
_BANDWIDTH = 30.0
"""rad/s, of each of them; the estimate is late by `_STAGES` / `_BANDWIDTH`."""
_EVERY = 0.02
"""s between two samples that count; in between, filtered data repeat themselves."""
_MEMORY = 0.4
"""s of motion in which a sample loses most of its weight, so that a payload picked up is known 2 s later."""
_FAST = 3.0 * REVERSAL
"""rad/s or m/s; a joint must be faster for as long as the filter remembers."""
_MODEL_ERROR = 0.01
"""Standard deviation of the torque that neither model nor payload explains, as a share of the effort limit."""
_GUESS = np.array([10.0, 1.0, 1.0, 1.0])
"""kg, kg m: standard deviations of mass and first moments before anything is known."""
_PARAMETERS = 4


class PayloadObserver:
    """Estimates mass and centre of mass of what an arm carries.

    Attributes:
        seen: time for which a joint has moved since the start, s.
    """

    def __init__(self, robot: TreeRobot, values: Mapping[str, Value], period: float) -> None:
        """Start without knowledge.

        Args:
            robot: the arm.
            values: every parameter of the controller; those of the robot, ``compensation`` and ``limits.effort``
                matter, the payload does not.
            period: of the samples, s.
        """
        joints = len(robot.joints)
        self._tree = robot.pack_model(values)
        viscous, coulomb, offset, limit = (
            joint_array(values[name], joints)
            for name in ("compensation.viscous", "compensation.coulomb", "compensation.offset", "limits.effort")
        )
        self._known = described_parameters(self._tree, viscous, coulomb)
        self._known[-joints:] = offset
        self._scale = 1.0 / (_MODEL_ERROR * limit)
        arm = robot.description
        link = LINK * int(rows(arm.tree)[arm.tool_row, Column.PLACE])
        placement = np.column_stack([arm.tool_rotation, arm.tool])
        self._link = slice(link, link + LINK)
        self._of_tool = np.array([moved(unit, placement) for unit in np.eye(LINK)[:_PARAMETERS]]).T
        self._decay = 1.0 - math.exp(-_BANDWIDTH * period)
        self._rate = self._decay / ((1.0 - self._decay) * period)
        self._period = period
        self._every = max(1, round(_EVERY / period))
        self._settling = round(_STAGES / _BANDWIDTH / period)
        self._stages = np.zeros((2, _STAGES, joints))
        self._fast = np.zeros(joints, dtype=np.int64)
        self._samples = 0
        self._information, self._sum = np.zeros((_PARAMETERS, _PARAMETERS)), np.zeros(_PARAMETERS)
        self.seen = 0.0

    def update(self, position: Array, effort: Array) -> None:
        """Take a sample.

        Args:
            position: measured, shape (joints,), rad or m.
            effort: applied before the measurement, shape (joints,), N m or N.
        """
        if self._samples == 0:
            self._stages[0], self._stages[1] = position, effort
        _low_pass(self._stages, position, effort, self._decay, self._rate, _FAST, self._fast)
        self._samples += 1
        if self._samples % self._every == 0:
            self._learn()

    @property
    def payload(self) -> Payload:
        """The estimate: a mass of at least zero, and its centre of mass in the tool frame."""
        mass, *moment = self._solution()[0]
        mass = max(float(mass), 0.0)
        return Payload(mass, np.array(moment) / mass if mass > self.deviation else np.zeros(3))

    @property
    def deviation(self) -> float:
        """Standard deviation of the mass, kg."""
        return float(math.sqrt(self._solution()[1][0, 0]))

    def _solution(self) -> tuple[Array, Array]:
        """Mass and first moments, and their covariance."""
        covariance = np.asarray(np.linalg.inv(self._information + np.diag(_GUESS**-2.0)), dtype=np.float64)
        return covariance @ self._sum, np.asarray(covariance, dtype=np.float64)

    def _learn(self) -> None:
        """Take the filtered data as rows of least squares."""
        usable = self._fast > self._settling
        if not usable.any():
            return
        s, r = self._stages[0], self._rate
        q, dq, ddq = s[3], r * (s[2] - s[3]), r * r * (s[1] - 2.0 * s[2] + s[3])
        matrix = regressor(self._tree, q[np.newaxis], dq[np.newaxis], ddq[np.newaxis])[0]
        rest = (self._stages[1, 3] - matrix @ self._known) * self._scale
        columns = (matrix[:, self._link] @ self._of_tool) * self._scale[:, np.newaxis]
        kept = math.exp(-self._every * self._period / _MEMORY)
        # Filtered errors of the model last for about as long as the filter remembers, so each counts once.
        weight = _EVERY * _BANDWIDTH / _STAGES
        self._information = kept * self._information + weight * columns[usable].T @ columns[usable]
        self._sum = kept * self._sum + weight * columns[usable].T @ rest[usable]
        self.seen += self._every * self._period


@njit
def _low_pass(
    stages: Array, position: Array, effort: Array, decay: float, rate: float, least: float, fast: NDArray[np.int64]
) -> None:
    """Advance the filters, and count the samples since each joint was slow; `stages` has shape (2, 4, joints)."""
    for j in range(position.size):
        for kind in range(2):
            value = position[j] if kind == 0 else effort[j]
            for i in range(stages.shape[1]):
                stages[kind, i, j] += decay * (value - stages[kind, i, j])
                value = stages[kind, i, j]
        velocity = rate * (stages[0, 2, j] - stages[0, 3, j])
        fast[j] = fast[j] + 1 if abs(velocity) > least else 0
