"""The controller as an object: checked parameters in, efforts out."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.events import first_compilation
from pidtsm_core.control.breakaway import forget_rests
from pidtsm_core.control.compliance_parameters import write_stiffness
from pidtsm_core.control.configuration import ControllerConfig, make_config
from pidtsm_core.control.findings import Finding, findings
from pidtsm_core.control.freedrive import refusal as cannot_be_free
from pidtsm_core.control.friction_learning import forget_friction
from pidtsm_core.control.handover import expect_handover
from pidtsm_core.control.late_drives import Lateness
from pidtsm_core.control.lateness import begin_lateness, refusal_of_freedrive
from pidtsm_core.control.lateness_learning import forget_lateness
from pidtsm_core.control.modes import begin_afresh, request, reset_fault, set_clock
from pidtsm_core.control.report import Change, changes, tight_rates
from pidtsm_core.control.state import (
    LAYOUT,
    Condition,
    ControllerMemory,
    External,
    Friction,
    Time,
    arrays_of,
    new_state,
    part,
)
from pidtsm_core.control.step import leave_now, respond, stop_after, stop_now, tick_now
from pidtsm_core.control.turns import distance
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Value, names
from pidtsm_core.robots import find_robot
from pidtsm_core.signals import Fault, Request, Signal, Status

_NEAR = 0.05
"""rad; if the arm is farther from its last estimated position, its motion cannot be continued."""


class Controller:
    """A controller of one robot, built from checked parameters.

    For each sample, write the measurement to `position` and the newest reference to `reference` or `given`, then call
    `step`.

    Attributes:
        joints: number of joints.
        position: measured q, shape (joints,), rad.
        measured: `position`, and the effort that the drives report (N m) if ``feedback.effort`` is ``measured``,
            shape (1 or 2, joints).
        reference: q_d, q_d', q_d'', shape (3, joints), rad, rad/s, rad/s^2.
        given: `reference`, and the effort (N m) that is fed forward, shape (4, joints).
        effort: the result of the last step, shape (joints,), N m.
        signals: likewise, shape (len(Signal), joints), order of `Signal`.
        config, state: what a step reads, and what it changes.
    """

    def __init__(self, values: Mapping[str, Value], effort: Array | None = None, signals: Array | None = None) -> None:
        """Build the controller.

        Args:
            values: every parameter of `controller_schema`, as `resolve` returns them.
            effort: array to which results are written; None: an array of its own.
            signals: likewise.
        """
        self._names = names(values["joints"])
        self.joints = len(self._names)
        self.effort = np.zeros(self.joints) if effort is None else effort
        self.signals = np.zeros((len(Signal), self.joints)) if signals is None else signals
        memory, rows = LAWS[str(values["law.name"])].memory, ESTIMATORS[str(values["estimator.name"])].rows
        self.state = new_state(
            self.joints,
            values["feedback.effort"] == "measured",
            memory(self.joints) if memory else 0,
            rows(self.joints) if rows else 0,
        )
        self._configure(values)
        self._memory = LAYOUT.store(self.memory)
        self.position, self.measured = self.state.measured, self.state.received
        self.reference, self.given = self.state.reference, self.state.given

    @property
    def memory(self) -> ControllerMemory:
        """What compiled code reads and changes."""
        return ControllerMemory(self.config, self.state, self.effort, self.signals)

    @cached_property
    def address(self) -> int:
        """Where compiled code that calls `respond` finds `memory`; it never changes."""
        return self._memory.address

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Use other parameters from the next step on; the state is kept.

        Args:
            values: as for the constructor, with the same law, estimator and robot.
        """
        before, old = self._demanding, self.config
        self._configure(values)
        self._memory.write(self.memory)
        if not old.adaptation.learns_friction or _differ(old.compensation, self.config.compensation):
            forget_friction(self.state)
        forget_rests(self.state)
        if not self.config.adaptation.softens:
            self.state.softened[0] = self.state.spared[0] = 0.0
        if self.config.drive.late and not old.drive.late:
            begin_lateness(self.state)
        if not (old.adaptation.learns_lateness and self.config.adaptation.learns_lateness) or _differ(
            _known(old), _known(self.config)
        ):
            forget_lateness(self.state)
        if _differ(before, self._demanding):
            expect_handover(self.state)

    def _configure(self, values: Mapping[str, Value]) -> None:
        robot = find_robot(values)
        config = make_config(values, robot)  # First: what it refuses changes nothing.
        self._values, self._units, self.config = values, robot.units, config
        # A copy, because models have scratch space. A payload that changes needs another effort.
        model = config.firmware.parameters.copy()
        own = config.law.gains, config.law.integers, config.estimator.parameters
        adapts = np.array(
            [config.adaptation.compensates_friction, config.adaptation.uses_lateness, config.adaptation.softens]
        )
        self._demanding = (model, *own, *config.compensation, adapts, *_known(config), config.drive.inversion)

    def reset(self) -> None:
        """Return to the initial state; measurements and reference are kept."""
        state = self.state
        kept = (state.measured, state.applied, state.received, state.reference, state.feedforward, state.given)
        for array in arrays_of(state):
            if not any(array is each for each in kept):
                array[:] = 0

    def compile(self) -> None:
        """Compile everything that a step may call, before the loop; afterwards the state is the initial one."""
        with first_compilation():
            respond(self.address, 0, -1)
            stop_now(self.address, int(Fault.STATE_STALE), 0)
            leave_now(self.address)
            part.prepare()
        set_clock(self.state, 0)
        reset_fault(self.config, self.state)
        self.reset()

    def step(self, stamp: int, reference_stamp: int) -> tuple[int, int, int, int, int]:
        """Respond to the measurement in `position`: write `effort` and `signals`.

        Args:
            stamp: stamp of the measurement, ns, later than the last one.
            reference_stamp: stamp of the reference in `reference`, ns; negative: there is none.

        Returns:
            The status, in the order of `Status`.
        """
        return respond(self.address, stamp, reference_stamp)

    def stop(self, fault: int, elapsed: int) -> None:
        """Write the safe effort, `elapsed` (ns) after the last joint state; see `stop_now`."""
        stop_now(self.address, int(fault), elapsed)

    def leave(self) -> None:
        """Write the last effort, which remains applied after the controller ends; see `leave_now`."""
        leave_now(self.address)

    @property
    def state_stop(self) -> int:
        """Longest gap between joint states that is no fault, ns."""
        return stop_after(self.config.watchdog.state_stop, int(self.state.times[Time.PERIOD]))

    def set_clock(self, stamp: int, elapsed: int) -> None:
        """Continue in a new time: the clock of the joint states was set, or their source was restarted.

        If the arm is where it was and `elapsed` is known, the state is kept, and the desired motion comes to rest
        because there is no reference of the new time yet. Otherwise the controller starts afresh from where the arm
        is. A fault stays.

        Args:
            stamp: stamp of the joint state in `position`, ns.
            elapsed: time since the last joint state that was answered, ns; 0: unknown.
        """
        moved = self._distances(self.state.signals[Signal.POSITION]).max()
        set_clock(self.state, stamp - (elapsed or 1))
        if not elapsed or moved > _NEAR:
            begin_afresh(self.state)

    def refusal(self, referred: bool) -> str:
        """Why the arm must not be moved now; empty if it may be moved. `referred`: there is a reference."""
        if not referred:
            return ""
        distances = self._distances(self.reference[0])
        farthest = distances.max()
        if farthest <= self.config.activation.distance:
            return ""
        joint = int(distances.argmax())
        return (
            f"{self._names[joint]} is {farthest:.3g} {self._units[joint].position} from its reference "
            f"(activation.distance {self.config.activation.distance:g})"
        )

    def request(self, wanted: Request) -> str:
        """Follow, hold or be free from the next step on.

        Returns:
            The reason if refused, else an empty text.
        """
        if wanted != Request.HOLD and self.fault:
            return "there is a fault; call ~/reset_fault"
        if wanted == Request.FREE and not self.config.uses_model:
            return "the law has no model of the arm, which would have to carry it"
        if wanted == Request.FREE and (reason := refusal_of_freedrive(self.config, self.state)):
            return reason
        if wanted == Request.FREE and (reason := cannot_be_free(self.config, self.state, self._names)):
            return reason
        request(self.state, int(wanted))
        return ""

    def _distances(self, from_position: Array) -> Array:
        """Distance of each joint from a position, shape (joints,), rad."""
        turn = self.config.turn
        return np.array([distance(turn, from_position, self.position, j) for j in range(self.joints)])

    def tare(self) -> None:
        """Take what acts from outside now for none: the reference yields to what is added to it, see compliance.py."""
        self.state.compliance.usual[:] = self.state.external[External.TWICE]

    def set_stiffness(self, space: str, stiffness: Sequence[float]) -> Value:
        """Yield with another stiffness from the next step on; at a fraction of the cost of `set_parameters`.

        Args:
            space: see `write_stiffness`, also for what it returns and raises.
            stiffness: likewise.
        """
        return write_stiffness(self.config.compliance, space, stiffness)

    def reset_fault(self) -> None:
        """Reset the fault, so that the controller can follow again."""
        reset_fault(self.config, self.state)

    @property
    def status(self) -> tuple[int, ...]:
        """The status of the controller, in the order of `Status`."""
        return tuple(self.state.status.tolist())

    @property
    def fault(self) -> int:
        """The latched fault, see `Fault`."""
        return int(self.state.status[Status.FAULT])

    @property
    def found(self) -> tuple[Finding, ...]:
        """Everything that the controller has found out about its arm, and is certain of."""
        return findings(self.config, self.state, self._names, self._units)

    @property
    def friction(self) -> Array:
        """What was found of the friction beyond ``compensation``, see friction_learning.py.

        Returns:
            Coulomb friction, its standard deviation (both N m) and viscous friction (N m s/rad), shape (3, joints); 0
            for a joint of which nothing is known yet.
        """
        found: Array = self.state.friction[[Friction.COULOMB, Friction.DEVIATION, Friction.VISCOUS]]
        return found

    @property
    def lateness(self) -> Array:
        """What was found of the lateness of the drives beyond ``drive``, see lateness_learning.py.

        Returns:
            Delay, lag, and the standard deviation of their sum, shape (3,), s. They are sure only if the drives are
            `late`; before, they are what is likely so far.
        """
        found: Array = self.state.lateness[[Lateness.FOUND_DELAY, Lateness.FOUND_LAG, Lateness.DEVIATION]]
        return found

    @property
    def late(self) -> bool:
        """Whether the drives were found to be later than ``drive`` says."""
        return bool(self.state.lateness[Lateness.LATE])

    @property
    def pace(self) -> float:
        """How fast the time of law and observer passes, dimensionless: less than 1 while the arm is softened."""
        return float(self.state.pace[0]) or 1.0

    @property
    def commanded(self) -> bool:
        """Whether there was a step since the last reset."""
        return bool(self.state.conditions[Condition.COMMANDED])

    def changes(self, before: Sequence[int] | None) -> list[Change]:
        """Changes of the status since it was `before` (None: since the start), as text."""
        return changes(before, self.status, self.state, self._names)

    def warnings(self) -> list[str]:
        """Warnings about parameters that are allowed but unsuitable."""
        return tight_rates(self._values)

    def tick(self, q: Array, desired: Array, dt: float) -> Array:
        """Run only estimator, law and model, with the effort limit but no other safety function; see `tick`.

        Args:
            q: measured positions, shape (joints,), rad, finite.
            desired: q_d, q_d', q_d'', shape (3, joints), finite.
            dt: time since the last call, s, 0 at the first.

        Returns:
            The signals, shape (len(Signal), joints), order of `Signal`; overwritten by the next call.
        """
        self.state.measured[:] = q
        self.state.desired[:] = desired
        tick_now(self.address, dt)
        return self.state.signals


def _known(config: ControllerConfig) -> tuple[Array, Array]:
    """Delay and lags of the drives, as the parameters have them."""
    return np.array([config.drive.delay]), config.drive.lag


def _differ(before: Sequence[NDArray[Any]], after: Sequence[NDArray[Any]]) -> bool:
    """Whether arrays have changed."""
    return any(not np.array_equal(a, b) for a, b in zip(before, after, strict=True))
