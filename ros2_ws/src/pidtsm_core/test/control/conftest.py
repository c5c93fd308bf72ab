"""A controller in a closed loop with the simulated arm, which tests disturb."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.parameters import Array, resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.signals import Fault
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

_MS = 1_000_000
_START = 1_000_000_000
_LIMITS = np.array([100.0, 50.0])


class Loop:
    """A controller at a rate, and the simulated arm at 1 kHz, heavier than the model by a given share.

    Attributes:
        efforts: commanded torques, N m, shape (2,) each.
        positions: positions of the arm, one every ms, rad.
    """

    def __init__(self, heavier: float = 0.0, rate: int = 1000, law: str = "piddtsm", **changes: Any) -> None:
        self._settings = {"law.name": law, **{n.replace("__", "."): v for n, v in changes.items()}}
        self.controller = Controller(resolve(controller_schema, self._settings, 2))
        share = {f"model_error.{quantity}": heavier for quantity in ("mass", "inertia")}
        self.robot = SimulatedRobot(resolve(simulator_schema, {"initial_position": [0.4, -0.02], **share}, 2))
        self.motion = ReferenceMotion(resolve(reference_schema, {}, 2))
        self.every, self.ms = 1000 // rate, 0
        self.efforts: list[Array] = []
        self.positions: list[Array] = []
        self.silent = False
        self.off = 0.0
        self._answered = 0

    def set(self, changes: dict[str, Any]) -> None:
        self.controller.set_parameters(resolve(controller_schema, {**self._settings, **changes}, 2))

    def go_on(self, ms: int) -> None:
        for _ in range(ms):
            stamp = _START + self.ms * _MS
            if not self.silent and self.ms % self.every == 0:
                self.motion.evaluate(self.ms * 1e-3, self.controller.reference)
                self.controller.position[:] = self.robot.state.arm.position
                self.controller.position[1] += self.off
                self.controller.step(stamp, stamp)
                self._answered = self.ms
                self.look()
            elif self.silent and self.ms % 5 == 0 and (self.ms - self._answered) * _MS > self.controller.state_stop:
                self.controller.stop(Fault.STATE_STALE, (self.ms - self._answered) * _MS)
                self.look()
            self.positions.append(self.robot.state.arm.position.copy())
            self.robot.act(self.ms, True, self.controller.effort)
            self.ms += 1

    def look(self) -> None:
        assert np.isfinite(self.controller.signals).all()
        assert (np.abs(self.controller.effort) <= _LIMITS).all()
        self.efforts.append(self.controller.effort.copy())

    def measure(self, samples: int, off: float) -> None:
        """Answer `samples` measurements of joint2 that are wrong by `off` (rad)."""
        self.off = off
        self.go_on(samples * self.every)
        self.off = 0.0

    def largest_step(self, since: int) -> float:
        """Largest change of the torque between two commands, N m, from the index `since` of `efforts` on."""
        return float(np.abs(np.diff(self.efforts[since:], axis=0)).max())

    @property
    def error(self) -> float:
        """Present error of the arm, rad."""
        desired = np.zeros((3, 2))
        self.motion.evaluate(self.ms * 1e-3, desired)
        return float(np.abs(self.robot.state.arm.position - desired[0]).max())

    def drift(self) -> float:
        """Let 10 s pass; return how far the arm moves after the first 2 s, rad."""
        self.go_on(2000)
        rested = len(self.positions)
        self.go_on(8000)
        return float(np.abs(np.array(self.positions[rested:]) - self.positions[rested]).max())


@pytest.fixture(scope="session")
def loop_of() -> type[Loop]:
    """See `Loop`."""
    return Loop
