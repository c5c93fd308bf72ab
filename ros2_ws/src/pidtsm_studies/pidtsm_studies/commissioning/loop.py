"""The loop of a commissioning: the project's controller answers every joint state of a port."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.report import cause
from pidtsm_core.parameters import Value, names, resolve
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Fault, Mode, Request, Status
from pidtsm_studies.commissioning.arm import CommissionError, Port, StoppedError
from pidtsm_studies.commissioning.motions import Motion, joined, rest, straight

_SETTLING = 0.5
"""Time at rest before a motion begins, s."""
_MOST_LOST = 400
"""Joint states lost in a row that are waited for."""
_TRANSIT, _GENTLE = 0.4, 1.5
"""Velocity (rad/s) and acceleration (rad/s^2) of the way to the begin of a motion."""
_STOPPING = 1.0
"""Time in which a controller that has stopped brings the arm to rest, s."""
_OF_GAINS = (Fault.TRACKING_LIMIT, Fault.VELOCITY_LIMIT, Fault.MEASUREMENT)
"""Why a controller stops that is too soft for friction, or too firm for elasticity or noise."""
_KEPT = ("law.name", "estimator.name", "robot.description", "robot.locked", "joints")
"""Parameters with which a controller can go on; with others it begins anew. A closed form has no description."""


@dataclass(frozen=True)
class Samples:
    """What was measured and commanded while the arm followed a motion.

    Attributes:
        stamps: ns, shape (samples,).
        position: measured, rad or m, shape (samples, joints).
        effort: commanded, N m or N, likewise.
        desired: q_d, q_d', q_d'', shape (samples, 3, joints).
        begin: index of the first sample of the motion; before, the arm moves to its first posture.
    """

    stamps: np.ndarray[Any, np.dtype[np.int64]]
    position: Array
    effort: Array
    desired: Array
    begin: int

    @property
    def time(self) -> Array:
        """Time since the first sample, s, shape (samples,)."""
        return np.asarray(1e-9 * (self.stamps - self.stamps[0]))

    @property
    def motion(self) -> "Samples":
        """Only the motion."""
        kept = slice(self.begin, None)
        return Samples(self.stamps[kept], self.position[kept], self.effort[kept], self.desired[kept], 0)

    def as_arrays(self) -> dict[str, Any]:
        """Its arrays by name."""
        return {name: getattr(self, name) for name in ("stamps", "position", "effort", "desired", "begin")}


class Loop:
    """Runs controllers on a port.

    Attributes:
        port: the arm, with its wiring.
        carry: answers one joint state so that the arm stays, before any controller has moved it; None: nothing does.
    """

    def __init__(self, port: Port, carry: Callable[[], object] | None = None) -> None:
        self.port, self.carry = port, carry
        self._controller: Controller | None = None
        self._identity: tuple[Any, ...] = ()
        self._next: tuple[Controller, Mapping[str, Value], tuple[Any, ...]] | None = None
        self._desired: Array | None = None

    @property
    def period(self) -> float:
        """Nominal time between joint states, s."""
        return self.port.period

    @property
    def moved(self) -> bool:
        """Whether a controller has moved the arm."""
        return self._controller is not None

    def _sense(self) -> Any:
        for _ in range(_MOST_LOST):
            measured = self.port.sense()
            if measured is not None:
                return measured
            self.port.act(None)
        raise CommissionError("no joint state arrives")

    def follow(self, settings: Mapping[str, Any], motion: Motion, prepared: bool = False) -> Samples:
        """Move the arm to the begin of a motion, let it rest there, and follow the motion.

        Args:
            settings: parameters of the controller that differ from their defaults.
            motion: the motion.
            prepared: whether `prepare` was called with these settings.

        Raises:
            StoppedError: the controller has stopped, and other gains may help; it holds the arm.
            CommissionError: it has stopped for another reason.
        """
        if not prepared:
            self.prepare(settings)
        controller = self._begin()
        measured = self._sense()
        start = measured.position.copy() if self._desired is None else self._desired
        way = joined(
            rest(start, _SETTLING),
            straight(start, motion.begin, np.full(start.size, _TRANSIT), np.full(start.size, _GENTLE)),
            rest(motion.begin, _SETTLING),
        )
        whole, first = joined(way, motion), measured.stamp
        rows: list[tuple[int, Array, Array, Array]] = []
        begin = 0
        while (time := 1e-9 * (measured.stamp - first)) <= whole.duration:
            whole.at(time, controller.reference)
            controller.position[:] = measured.position
            controller.step(measured.stamp, measured.stamp)
            effort = controller.effort.copy()
            if (shaking := whole.shaking_at(time)) is not None and not controller.fault:
                limit = controller.config.limits.effort
                effort = np.clip(effort + shaking, -limit, limit)
            self.port.act(effort)
            rows.append((measured.stamp, measured.position.copy(), effort, controller.reference.copy()))
            if controller.fault:
                self._desired = None
                self._come_to_rest(controller)
                text = f"the controller has stopped the arm: {self._cause(controller, settings)}"
                if controller.fault in _OF_GAINS:
                    raise StoppedError(text)
                raise CommissionError(text)
            begin += time < way.duration
            # Delays may bring no joint state in this sample; the drives keep the last torque.
            measured = self._sense()
        self.port.act(controller.effort)
        self._desired = whole.end.copy()
        stamps, position, effort, desired = (np.array(column) for column in zip(*rows, strict=True))
        return Samples(stamps, position, effort, desired, begin)

    def _come_to_rest(self, controller: Controller) -> None:
        """Let a controller that has stopped bring the arm to rest."""
        for _ in range(round(_STOPPING / self.period)):
            measured = self._sense()
            controller.position[:] = measured.position
            controller.step(measured.stamp, measured.stamp)
            self.port.act(controller.effort)

    def hold(self) -> None:
        """Answer one joint state so that the arm stays where it is; with nothing if nothing has carried it yet."""
        controller = self._controller
        if controller is None and self.carry is not None:
            self.carry()
            return
        measured = self._sense()
        if controller is None:
            self.port.act(None)
            return
        controller.request(Request.HOLD)
        controller.position[:] = measured.position
        controller.step(measured.stamp, measured.stamp)
        self.port.act(controller.effort)
        self._desired = None

    def prepare(self, settings: Mapping[str, Any]) -> None:
        """Build the controller that `follow` needs, which takes a while if its model is new; it may hold meanwhile."""
        values = resolve(controller_schema, settings, robot_joints(settings))
        identity = tuple(values.get(name) for name in _KEPT)
        if self._controller is None or identity != self._identity:
            controller = Controller(values)
            controller.compile()
        else:
            controller = self._controller
        self._next = (controller, values, identity)

    def _begin(self) -> Controller:
        """Begin to use what is prepared, from where the last controller was if it can go on."""
        assert self._next is not None
        controller, values, self._identity = self._next
        if controller is self._controller:
            controller.set_parameters(values)
        self._controller, self._next = controller, None
        if controller.fault:
            controller.reset_fault()
        if controller.status[Status.MODE] != Mode.FOLLOWING:
            controller.request(Request.FOLLOW)
        return controller

    @staticmethod
    def _cause(controller: Controller, settings: Mapping[str, Any]) -> str:
        joints = names(resolve(controller_schema, settings, robot_joints(settings))["joints"])
        return cause(controller.fault, controller.status[Status.FAULT_JOINT], joints)
