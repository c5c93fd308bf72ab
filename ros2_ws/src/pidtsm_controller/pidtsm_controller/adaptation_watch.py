"""Reports what the controller has found out about its arm: friction, and the lateness of the drives."""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.control import Controller
from pidtsm_core.units import JointUnits
from pidtsm_ros.diagnostics import Reading

_WORTH_A_LINE = 0.02
"""Share of the effort limit."""
_NEWS = 0.25
"""Share by which it must have changed since the last line."""
_LEAST_NEWS = 0.003
"""s; likewise, of the lateness."""


class AdaptationWatch:
    """Readings for /diagnostics, and lines for the log where something new was found."""

    def __init__(self, controller: Controller, joints: Sequence[str], units: Sequence[JointUnits]) -> None:
        """Args: joints, units: names and units of the controller's joints."""
        self._controller, self._joints, self._units = controller, joints, units
        self._told = np.zeros(len(joints))
        self._told_lateness = 0.0

    def readings(self) -> list[Reading]:
        """What was found, and its standard deviation: Coulomb friction of each joint, and lateness once it is sure."""
        adapts, found = self._controller.config.adaptation, []
        if adapts.learns_friction:
            coulomb, deviation, _ = self._controller.friction
            found += [
                Reading(f"{what} of {joint}", float(value), unit.effort)
                for what, values in (("friction found", coulomb), ("deviation of the friction", deviation))
                for joint, unit, value in zip(self._joints, self._units, values, strict=True)
            ]
        if adapts.learns_lateness and self._controller.late:
            names = ("delay of the drives found", "lag of the drives found", "deviation of their sum")
            found += [
                Reading(name, float(value), "s") for name, value in zip(names, self._controller.lateness, strict=True)
            ]
        return found

    def news(self) -> list[str]:
        """A line for each joint whose certain friction has changed much since its last line; likewise for lateness."""
        adapts = self._controller.config.adaptation
        lines = self._friction_news() if adapts.learns_friction else []
        return lines + (self._lateness_news() if adapts.learns_lateness else [])

    def _friction_news(self) -> list[str]:
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

    def _lateness_news(self) -> list[str]:
        if not self._controller.late:
            return []
        delay, lag, deviation = self._controller.lateness
        total = delay + lag
        if abs(total - self._told_lateness) < max(_LEAST_NEWS, _NEWS * self._told_lateness):
            return []
        self._told_lateness = total
        acts = self._controller.config.adaptation.uses_lateness
        done = "compensated" if acts else "not compensated (adaptation.lateness: warn)"
        return [
            f"the drives are {1e3 * total:.0f} ± {1e3 * deviation:.0f} ms later than drive.delay and drive.lag (delay "
            f"{1e3 * delay:.0f} ms, lag {1e3 * lag:.0f} ms), {done}"
        ]
