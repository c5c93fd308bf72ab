"""A controller in a closed loop with the simulated arm, which tests disturb."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.testarms import Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.signals import Fault, Signal
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

_MS = 1_000_000
_START = 1_000_000_000


class Loop:
    """A controller at a rate, and the simulated arm at 1 kHz, heavier than the model by a given share.

    Attributes:
        efforts: commanded torques, N m, shape (joints,) each.
        falsify: what the encoders make of the positions.
        positions: positions of the arm, one every ms, rad or m.
    """

    def __init__(self, arm: Arm, heavier: float = 0.0, rate: int = 1000, law: str = "piddtsm", **changes: Any) -> None:
        self.arm, motion = arm, arm.motion(near=True)
        self._settings = {"law.name": law, **arm.gains(law), **dotted(changes)}
        self.controller = Controller(arm.values(controller_schema, self._settings))
        share = {f"model_error.{quantity}": heavier for quantity in ("mass", "inertia")}
        both = {name: value for name, value in self._settings.items() if name == "output.gravity"}
        self.robot = SimulatedRobot(arm.values(simulator_schema, {**motion["simulator"], **share, **both}))
        trajectory = {"joints": arm.names, **motion["trajectory"]}
        self.motion = ReferenceMotion(resolve(reference_schema, trajectory, arm.joints))
        self.every, self.ms = 1000 // rate, 0
        self.efforts: list[Array] = []
        self.positions: list[Array] = []
        self.silent = False
        self.off = np.zeros(arm.joints)
        self.falsify: Callable[[Array], Array] = lambda q: q
        self._frozen = False
        self._answered = 0

    def set(self, changes: dict[str, Any]) -> None:
        self.controller.set_parameters(self.arm.values(controller_schema, {**self._settings, **changes}))

    def values(self) -> dict[str, Any]:
        """Every parameter of the controller."""
        return self.arm.values(controller_schema, self._settings)

    def freeze(self, frozen: bool = True) -> None:
        """Hold the arm where it is, whatever the torques are, or let it go."""
        self._frozen = frozen

    def continue_from(self, other: "Loop") -> None:
        """Continue, with the same parameters, where another loop is."""
        for mine, theirs in zip(_arrays(self), _arrays(other), strict=True):
            mine[:] = theirs
        self.ms, self._answered = other.ms, other._answered
        self.efforts, self.positions = other.efforts[-1:], other.positions[-1:]

    def go_on(self, ms: int) -> None:
        answers: list[Array] = []
        controller, state = self.controller, self.robot.state.arm
        for _ in range(ms):
            stamp = _START + self.ms * _MS
            if not self.silent and self.ms % self.every == 0:
                self.motion.evaluate(self.ms * 1e-3, controller.reference)
                controller.position[:] = self.falsify(state.position + self.off)
                controller.step(stamp, stamp)
                self._answered = self.ms
                answers.append(controller.signals.copy())
            elif self.silent and self.ms % 5 == 0 and (self.ms - self._answered) * _MS > controller.state_stop:
                controller.stop(Fault.STATE_STALE, (self.ms - self._answered) * _MS)
                answers.append(controller.signals.copy())
            self.positions.append(state.position.copy())
            if not self._frozen:
                self.robot.act(self.ms, True, controller.effort)
            self.ms += 1
        if answers:
            signals = np.array(answers)
            assert np.isfinite(signals).all()
            assert (np.abs(signals[:, Signal.EFFORT]) <= self.arm.limits).all()
            self.efforts.extend(signals[:, Signal.EFFORT])

    def measure(self, samples: int, off: float, joint: int = -1) -> None:
        """Answer `samples` measurements of a joint, by default the last one, that are wrong by `off` (rad or m)."""
        self.off[joint] = off
        self.go_on(samples * self.every)
        self.off[joint] = 0.0

    def largest_step(self, since: int) -> float:
        """Largest change of a torque between two commands, from the index `since` of `efforts` on, as a share of its
        limit."""
        return float((np.abs(np.diff(self.efforts[since:], axis=0)) / self.arm.limits).max())

    @property
    def error(self) -> float:
        """Present error of the arm, rad or m."""
        desired = np.zeros((3, self.arm.joints))
        self.motion.evaluate(self.ms * 1e-3, desired)
        return float(np.abs(self.robot.state.arm.position - desired[0]).max())

    def drift(self) -> float:
        """Let 3 s pass; return how far the arm moves in the last one, rad or m."""
        self.go_on(2000)
        rested = len(self.positions)
        self.go_on(1000)
        return float(np.abs(np.array(self.positions[rested:]) - self.positions[rested]).max())


def _arrays(loop: Loop) -> Iterator[NDArray[Any]]:
    """Everything that a loop changes, except the time."""
    controller = loop.controller
    yield from _members((controller.config, controller.state, controller.effort, controller.signals, loop.robot.state))


def _members(state: Any) -> Iterator[NDArray[Any]]:
    for member in state:
        if isinstance(member, np.ndarray):
            yield member
        elif isinstance(member, tuple):
            yield from _members(member)


@pytest.fixture(scope="module")
def loop_of(arm: Arm) -> Callable[..., Loop]:
    """Make a loop of the arm, see `Loop`, that has run for `after` ms."""
    before: dict[str, Loop] = {}

    def make(after: int = 0, **settings: Any) -> Loop:
        loop = Loop(arm, **settings)
        if after:
            key = f"{after} {sorted(settings.items())}"
            if key not in before:
                before[key] = Loop(arm, **settings)
                before[key].go_on(after)
            loop.continue_from(before[key])
        return loop

    return make
