"""What catches the joints of an arm whose signs are not known yet, and judges the signs by how they react."""

from collections.abc import Callable

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import CommissionError, Port
from pidtsm_studies.commissioning.model import ArmModel

FARTHEST = 0.02
"""rad or m; no joint moves farther in this step, or commands cease."""
_VISIBLE_NOISE, _VISIBLE_STEPS, _VISIBLE = 6.0, 2.5, 0.001
"""A joint has moved if it is farther away than these multiples of noise and encoder step, and than this, rad or m."""
_RATE_FILTER = 150.0
"""rad/s; of the velocity for the damper."""
_CREEPS, _WATCH = 0.3, 0.1
"""A joint that moves less than this share of what is visible, in so many s, counts as held by friction."""
_FEW = 6
"""Samples that are too few to tell how a joint reacts to the catch."""
_REACTS = 0.01
"""s from the catch of a joint to its first visible effect: delay and lag of the drive, and `_RATE_FILTER`."""
_SLOWER = 0.98
"""Share of its speed below which a caught joint is being stopped."""
_HEAVY = 1.5
"""Ratio from which on a joint that the catch has pushed away is taken for heavier than described."""
_LIGHTEST = 2.0
"""Ratio of what a torque seems to accelerate a joint by, and should, from which on something else does."""
_HEAVIEST = 12.0
"""Largest ratio of a joint's inertia and the described one."""
_WRONG = 0.4
"""Share of `FARTHEST` from which on the sign of a caught joint is wrong in any case."""
_LOADED = 0.01
"""Share of the effort limit from which on gravity matters to a joint."""
_STOPS = 1.5
"""A catch with the right sign stops a joint within this multiple of its velocity by the pole."""
_LOSSES = 0.005
"""Share of lost joint states that needs mention."""
_WATCHED, _CALMS = 1.0, 0.8
"""s in which the arm is watched without commands, and share of its scatter below which it is watched again."""


class AwayError(CommissionError):
    """A joint moves too far; commands have ceased.

    Attributes:
        joint: its index.
    """

    def __init__(self, text: str, joint: int) -> None:
        super().__init__(text)
        self.joint = joint


class Catch:
    """A spring, a damper and an integral of each joint about where it began, on top of the torque of the model."""

    def __init__(self, port: Port, model: ArmModel, stiff: float, sign: Array, tell: Callable[[str], None]) -> None:
        """Look at the arm at rest, for a second.

        Args:
            port: the arm as its messages have it.
            model: its description.
            stiff: triple pole of the catch, rad/s.
            sign: of the torques as far as they are known, 1 or -1, shape (joints,).
            tell: called with each finding at once.
        """
        self.port, self.model, self.stiff, self.tell = port, model, stiff, tell
        self.start, self.visible = _at_rest(port)
        at = self.start
        joints = at.size
        self.sign = sign.copy()  # of the torques
        self.inverted: list[int] = []  # joints in the order in which their signs were changed
        self.caught = np.zeros(joints, dtype=bool)
        self.fell = np.zeros(joints, dtype=bool)  # whether a joint moved as its weight pulls, before it was caught
        self.sure = np.zeros(joints, dtype=bool)  # whether a sign was judged by the catch
        self.nudged = -1  # the joint that shall not be caught
        self._bound = np.full(joints, np.inf)  # way beyond which the sign of a caught joint is wrong
        self.inertia = model.inertia(at)
        self.carried = model.gravity(at[np.newaxis])[0]
        self._sum, self._rate, self._last = np.zeros(joints), np.zeros(joints), at.copy()
        self._past = [at.copy()] * max(1, round(_WATCH / port.period))  # positions of the last samples
        self.moves = np.zeros(joints, dtype=bool)  # else friction holds it
        self._stamp = -1
        self.judges = False
        self._speed = np.zeros(joints)  # largest of each joint since it was caught
        self._since = np.zeros(joints, dtype=np.int64)  # rows at the catch of each joint
        self._torques: list[Array] = []  # of the catch, one for each row
        self.rows: list[tuple[float, Array, Array]] = []
        self._lost = 0  # joint states that did not come
        self.farthest = np.zeros(joints)

    def invert(self, j: int, carried: bool) -> None:
        """Take a joint for inverted; if it may be its position, the described couplings no longer count.

        Args:
            j: the joint.
            carried: whether the torque that acted on it until now carried it.
        """
        self.sign[j] *= -1.0
        self.inverted.append(j)
        if carried:
            self.carried[j] *= -1.0
            self._weigh(j, float(np.linalg.inv(self.inertia)[j, j]))

    def catch(self, j: int) -> None:
        """Catch a joint; if it then goes on as it moves now, its sign was wrong."""
        way = self._last[j] - self.start[j]
        if not self.caught[j]:
            loaded = abs(self.carried[j]) > _LOADED * self.model.effort[j]
            self.fell[j] = loaded and way * self.carried[j] < 0.0
        self.caught[j] = True
        self._sum[j] = 0.0
        way = abs(way)
        stops = way + _STOPS * abs(self._rate[j]) / self.stiff + self.visible[j]
        self._bound[j] = max(min(stops, _WRONG * FARTHEST), way + self.visible[j])
        self._since[j] = len(self.rows)
        self._speed[j] = abs(self._rate[j])

    def _judge(self, way: Array) -> None:
        """Catch joints that have begun to move, and change the signs of those that the catch pushes away."""
        for moved in np.flatnonzero((np.abs(way) > self.visible) & ~self.caught).tolist():
            if moved != self.nudged:
                self.catch(moved)
        reacted = (len(self.rows) - self._since) * self.port.period > _REACTS
        if np.any(beyond := self.caught & reacted & (np.abs(way) > self._bound)):
            j = int(np.argmax(np.where(beyond, np.abs(way) / self._bound, 0.0)))
            if abs(self._rate[j]) < _SLOWER * self._speed[j]:  # It is being stopped.
                self._bound[j] += self.visible[j]
                return
            mobility, described = self._mobility(j), 1.0 / float(self.inertia[j, j])
            most = _LIGHTEST * float(np.linalg.inv(self.inertia)[j, j])
            if mobility < 0.0 and not described / _HEAVIEST < -mobility < most:  # It is another joint that pulls it.
                self._bound[j] += self.visible[j]
                return
            if mobility < 0.0 and not self.sure[j]:
                self.invert(j, carried=not self.fell[j])
                self.tell(f"the sign of {self.model.joints[j]} is inverted (what should hold it pushed it away)")
                self._sum[:] = 0.0
                if abs(mobility) < described / _HEAVY:
                    self._weigh(j, mobility)
            elif 0.0 < mobility < described / _HEAVY:  # The catch is too weak, as for a rotor that is not described.
                self._weigh(j, max(mobility, 0.5 * described))
            self.sure[j] = True
            for other in np.flatnonzero(self.caught).tolist():
                self.catch(other)  # It was pushed too, and shall not be judged by that.

    def _mobility(self, j: int) -> float:
        """What the torque of the catch accelerates joint j by, 1/(kg m^2), negative if it is inverted.

        From the motion since the catch: position = a + b t + c t^2 + mobility times the double integral of the torque.
        """
        rows = self._torques[self._since[j] :]
        dt, torque = self.port.period, np.array([each[j] for each in rows])
        q = np.array([row[1][j] for row in self.rows[-len(rows) :]])
        if q.size < _FEW:
            return -1.0 / float(self.inertia[j, j])
        time = dt * np.arange(q.size)
        pushed = dt**2 * np.concatenate([[0.0], np.cumsum(np.cumsum(torque))[:-1]])
        columns = np.column_stack([np.ones_like(time), time, time**2, pushed])
        size = np.abs(columns).max(axis=0) + 1e-12
        return float(np.linalg.lstsq(columns / size, q, rcond=None)[0][-1] / size[-1])

    def weigh(self, j: int, inertia: float) -> None:
        """Take over the inertia of joint j, kg m^2 or kg; its couplings and what holds it remain as they are."""
        self._sum[j] *= self.inertia[j, j] / inertia
        self.inertia[j, j] = inertia

    def _weigh(self, j: int, mobility: float) -> None:
        """Take over the inertia that joint j has shown when it was pushed; rotors are often not described."""
        described = float(np.diag(self.model.inertia(self.start))[j])
        self.inertia[j], self.inertia[:, j] = 0.0, 0.0
        self.inertia[j, j] = np.clip(1.0 / max(abs(mobility), 1e-9), 0.5 * described, _HEAVIEST * described)

    def step(self, extra: Array | None = None) -> Array:
        """Answer one joint state.

        Args:
            extra: torque on top of that of the catch, shape (joints,), N m or N.

        Returns:
            The way of each joint from the begin, shape (joints,), rad or m.

        Raises:
            AwayError: a joint moves too far; commands have ceased.
        """
        measured = self.port.sense()
        while measured is None:
            self._lost += 1
            self.port.act(None)
            measured = self.port.sense()
        dt = 1e-9 * (measured.stamp - self._stamp) if self._stamp >= 0 else self.port.period
        self._stamp = measured.stamp
        q = measured.position
        way = q - self.start
        share = min(1.0, _RATE_FILTER * dt)
        self._rate += share * ((q - self._last) / dt - self._rate)
        np.maximum(self._speed, np.abs(self._rate), out=self._speed)
        self._last = q.copy()
        np.maximum(self.farthest, np.abs(way), out=self.farthest)
        if self.judges:
            self._judge(way)
        if np.any(np.abs(way) > FARTHEST):
            self.port.act(None)
            away = int(np.abs(way).argmax())
            name, far = self.model.joints[away], float(np.abs(way[away]))
            raise AwayError(
                f"{name} moves away although it should be held, by {far:.3g} (allowed: {FARTHEST:g}); commands have "
                "ceased, so that the brakes close. Check the order of the joints, their units and the description"
                f"{self._losses()}",
                away,
            )
        # Of a joint that sticks, the integral would grow until it leaps.
        self._past.append(q.copy())
        self.moves = np.abs(q - self._past.pop(0)) > _CREEPS * self.visible
        self._sum += np.where(self.caught & self.moves, way * dt, 0.0)
        pole = self.stiff
        pull = 3.0 * pole**2 * way + pole**3 * self._sum + 3.0 * pole * self._rate
        # What friction holds is not accelerated, and does not take the others with it.
        pull = np.where(self.caught, pull, 0.0)
        coupled = np.where(self.moves, pull, 0.0)
        held = -self.inertia @ coupled - np.diag(self.inertia) * (pull - coupled)
        self._torques.append(held)
        torque = self.carried + held
        if extra is not None:
            torque = torque + extra
        torque = np.clip(torque, -self.model.effort, self.model.effort)
        self.port.act(self.sign * torque)
        self.rows.append((1e-9 * measured.stamp, q.copy(), torque))
        return way

    def _losses(self) -> str:
        """What to say of joint states that did not come, as the end of a text."""
        share = self._lost / (self._lost + len(self.rows))
        return f"; {100.0 * share:.1f} % of the joint states are lost" if share > _LOSSES else ""


def _at_rest(port: Port) -> tuple[Array, Array]:
    """Mean position of the arm without commands, and the way from which on a joint has visibly moved."""
    scatter = np.inf
    while True:
        # In the first half brakes may still be closing; what swings afterwards, as after a try that went wrong, calms.
        q = _watched(port)
        before, scatter = scatter, float(_VISIBLE_NOISE * q.std(axis=0).max())
        if scatter < _VISIBLE or scatter > _CALMS * before:
            break
    gaps = [np.diff(np.unique(column)) for column in q.T]
    step = np.array([float(each.min()) if each.size else 0.0 for each in gaps])
    return q.mean(axis=0), np.maximum(_VISIBLE, np.maximum(_VISIBLE_NOISE * q.std(axis=0), _VISIBLE_STEPS * step))


def _watched(port: Port) -> Array:
    """Positions in the second half of some time without commands, shape (samples, joints)."""
    positions = []
    for _ in range(max(20, round(_WATCHED / port.period))):
        measured = port.sense()
        port.act(None)
        if measured is not None:
            positions.append(measured.position.copy())
    return np.array(positions[len(positions) // 2 :])
