"""A controller in a closed loop with the simulated arm, which the test disturbs."""

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
    """A controller at a rate, and the simulated arm at 1 kHz, with a mass that differs from the model's by a share.

    Attributes:
        efforts: torques commanded, N m, shape (2,) each.
        positions: of the arm, one every ms, rad.
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
        """So many measurements of joint2 that are off, rad."""
        self.off = off
        self.go_on(samples * self.every)
        self.off = 0.0

    def largest_step(self, since: int) -> float:
        """Of the torque, N m, from a place in `efforts` on."""
        return float(np.abs(np.diff(self.efforts[since:], axis=0)).max())

    @property
    def error(self) -> float:
        """Of the arm now, rad."""
        desired = np.zeros((3, 2))
        self.motion.evaluate(self.ms * 1e-3, desired)
        return float(np.abs(self.robot.state.arm.position - desired[0]).max())

    def drift(self) -> float:
        """How far the arm goes in 10 s, once it has come to rest, rad."""
        self.go_on(2000)
        rested = len(self.positions)
        self.go_on(8000)
        return float(np.abs(np.array(self.positions[rested:]) - self.positions[rested]).max())


@pytest.fixture(scope="session")
def loop_of() -> type[Loop]:
    """See `Loop`."""
    return Loop
