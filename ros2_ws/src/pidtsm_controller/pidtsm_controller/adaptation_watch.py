"""Reports what the controller has found out about its arm: friction, lateness of the drives, rough commands."""

from pidtsm_core.control import Controller
from pidtsm_core.control.findings import What, readings, statements
from pidtsm_ros.diagnostics import Reading

_NEWS = 0.25
"""Share by which a value must have changed since the last line."""


class AdaptationWatch:
    """Readings for /diagnostics, and lines for the log where something new was found."""

    def __init__(self, controller: Controller) -> None:
        """Args: controller: whose findings are reported."""
        self._controller = controller
        self._told: dict[tuple[What, str], float] = {}

    def readings(self) -> list[Reading]:
        """What was found, with its standard deviation where it is known."""
        return [Reading(*each) for each in readings(self._controller.found)]

    def news(self) -> list[str]:
        """A line for everything that was found since the last call, or has changed much since its last line."""
        lines, now = [], statements(self._controller.found)
        for each in now:
            told = self._told.get((each.what, each.joint), 0.0)
            if abs(each.value - told) > _NEWS * abs(told):
                self._told[each.what, each.joint] = each.value
                lines.append(f"{each.text}, {self._done(each.what)}")
        softened = (What.PACE, "")
        if softened in self._told and all(each.what is not What.PACE for each in now):
            del self._told[softened]
            lines.append("law and observer are as before")
        return lines

    def _done(self, what: What) -> str:
        """What the controller does about it."""
        adapts = self._controller.config.adaptation
        if what in (What.ROUGHNESS, What.PACE):
            return "softened" if adapts.softens else "not softened (adaptation.softening: warn)"
        friction = what is What.FRICTION
        if adapts.compensates_friction if friction else adapts.uses_lateness:
            return "compensated"
        return f"not compensated (adaptation.{'friction' if friction else 'lateness'}: warn)"
