"""Reports the friction that the controller has found in its arm."""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.control import Controller
from pidtsm_core.units import JointUnits
from pidtsm_ros.diagnostics import Reading

_WORTH_A_LINE = 0.02
"""Share of the effort limit."""
_NEWS = 0.25
"""Share by which it must have changed since the last line."""


class FrictionWatch:
    """Readings for /diagnostics, and lines for the log where something new was found."""

    def __init__(self, controller: Controller, joints: Sequence[str], units: Sequence[JointUnits]) -> None:
        """Args: joints, units: names and units of the controller's joints."""
        self._controller, self._joints, self._units = controller, joints, units
        self._told = np.zeros(len(joints))

    def readings(self) -> list[Reading]:
        """The Coulomb friction of each joint and its standard deviation."""
        coulomb, deviation, _ = self._controller.friction
        return [
            Reading(f"{what} of {joint}", float(value), unit.effort)
            for what, values in (("friction found", coulomb), ("deviation of the friction", deviation))
            for joint, unit, value in zip(self._joints, self._units, values, strict=True)
        ]

    def news(self) -> list[str]:
        """A line for each joint whose certain friction has changed much since its last line."""
        coulomb, deviation, _ = self._controller.friction
        certain = np.sign(coulomb) * np.maximum(np.abs(coulomb) - deviation, 0.0)
        limit = self._controller.config.limits.effort
        acts = self._controller.config.adaptation.compensates_friction
        lines = []
        for j, (joint, unit) in enumerate(zip(self._joints, self._units, strict=True)):
            changed = abs(certain[j] - self._told[j])
            if changed < max(_WORTH_A_LINE * limit[j], _NEWS * abs(self._told[j])):
                continue
            self._told[j] = certain[j]
            done = "compensated" if acts else "not compensated (adaptation.friction: warn)"
            lines.append(
                f"{joint}: found {coulomb[j]:.3g} ± {deviation[j]:.2g} {unit.effort} of friction beyond "
                f"compensation.coulomb, {done}"
            )
        return lines
