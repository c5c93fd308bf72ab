"""Controls that disturb the simulated arm, or break a part of the system."""

from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.nodes import Nodes

_FORCE, _MASS, _LASTS = 50.0, 0.5, 0.3
_LONGEST_PUSH = 5.0  # s
_LARGEST = 1e6
"""Largest force (N) or mass (kg) that can be entered."""


class Pushing:
    """A push on the tool."""

    def __init__(self, desk: Desk) -> None:
        """Add the controls to the current container."""
        self._desk, gui = desk, desk.server.gui
        with gui.add_folder("Push the tool"):
            hint = "force on the tool in the axes of the base (N)"
            self._force = gui.add_vector3("force [N]", (0.0, 0.0, -_FORCE), step=0.1, hint=hint)
            self._lasts = gui.add_number("for [s]", _LASTS, min=0.05, max=_LONGEST_PUSH, step=0.05, hint="duration")
            desk.button("Push", self._push, "push the tool of the simulated arm with this force")

    async def _push(self) -> None:
        force = [min(max(float(value), -_LARGEST), _LARGEST) for value in self._force.value]
        lasts = min(max(float(self._lasts.value), 0.0), _LONGEST_PUSH)
        self._desk.system.note(f"push of ({force[0]:g}, {force[1]:g}, {force[2]:g}) N for {lasts:g} s")
        await self._desk.system.push(force, (0.0, 0.0, 0.0), lasts)


class Carrying:
    """A load that the arm picks up and drops; unknown to the controller."""

    def __init__(self, desk: Desk) -> None:
        """Add the controls to the current container."""
        self._desk, gui = desk, desk.server.gui
        with gui.add_folder("Load"):
            self._mass = gui.add_number("mass [kg]", _MASS, min=0.0, max=_LARGEST, step=0.05, hint="mass at the tool")
            desk.button("Pick up", self._pick_up, "the arm carries this mass from now on; unknown to the controller")
            desk.button("Drop", self._drop, "the arm carries nothing")

    async def _pick_up(self) -> None:
        mass = float(self._mass.value)
        await self._desk.system.set("simulator", {"payload.mass": mass, "payload.time": 0.0, "payload.duration": 0.0})
        self._desk.system.note(f"picked up {mass:g} kg")

    async def _drop(self) -> None:
        await self._desk.system.set("simulator", {"payload.mass": 0.0})
        self._desk.system.note("dropped the load")


class Breaking:
    """A controller that crashes or hangs, if the page has started it."""

    def __init__(self, desk: Desk) -> None:
        """Add the controls to the current container."""
        self._desk = desk
        with desk.server.gui.add_folder("Break the controller"):
            desk.button("Kill the controller", self._kill, "end its process at once, as a crash does", color="red")
            desk.button("Freeze the controller", self._freeze, "suspend its process, as if it hung")
            desk.button("Let it go on", self._thaw, "resume the suspended process")

    def _note(self, text: str) -> None:
        self._desk.system.note(text)

    async def _kill(self) -> None:
        self._owned.kill("controller")
        self._note("controller killed")

    async def _freeze(self) -> None:
        self._owned.freeze("controller")
        self._note("controller suspended")

    async def _thaw(self) -> None:
        self._owned.thaw("controller")
        self._note("controller resumed")

    @property
    def _owned(self) -> Nodes:
        if self._desk.nodes is None:
            raise RefusedError("the controller was not started by this page")
        return self._desk.nodes
