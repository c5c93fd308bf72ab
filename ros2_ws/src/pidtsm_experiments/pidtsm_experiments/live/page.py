"""The page: builds its parts, and keeps them up to date."""

import asyncio
import itertools
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from viser import GuiTabGroupHandle

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import DESCRIPTION, Description, description_schema, find_description, find_robot
from pidtsm_core.signals import Signal
from pidtsm_core.units import joint_units
from pidtsm_experiments.live.commission import Commissioning
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.disturb import Breaking, Carrying, Pushing
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.forms import NodeForms
from pidtsm_experiments.live.keep import Recorded, Saved
from pidtsm_experiments.live.lives import Condition
from pidtsm_experiments.live.motion import Moving
from pidtsm_experiments.live.recording import Recording
from pidtsm_experiments.live.scene import ArmScene
from pidtsm_experiments.live.stiffness import Stiffness
from pidtsm_experiments.live.stream import Batch
from pidtsm_experiments.live.strip import Strip
from pidtsm_experiments.live.switches import Switches
from pidtsm_experiments.live.tool import Tool
from pidtsm_experiments.live.undo import Undo
from pidtsm_experiments.live.verdicts import Verdicts
from pidtsm_experiments.live.watch import Status, Watching
from pidtsm_experiments.live.withdraw import Withdrawal
from pidtsm_experiments.live.words import OLD
from pidtsm_ros.stop import Stop
from pidtsm_studies.reports.meshes import solids_of

_PERIOD = 0.05
"""Time between two pictures of the arm, s."""
_LOOK = 1.0
"""Time between two looks for a trajectory node, s."""
_DRAW_EVERY, _TELL_EVERY = 4, 10
"""Pictures between two updates of the curves, and of the texts."""
_CONTROLS = 340
"""Width of the controls, px; see `watch`."""
_Answer = TypeVar("_Answer")


class Page:
    """Everything on the page."""

    def __init__(self, desk: Desk, recording: Recording) -> None:
        """Show that there is nothing to show yet."""
        self._desk, self._recording = desk, recording
        gui = desk.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_CONTROLS)
        self._forms: dict[str, NodeForms] = {}
        self._status = Status(desk)
        self._strip = Strip(desk, recording, self._start_again)
        self._undo = Undo(desk, self._forms)
        self._lost: set[str] = set()
        self._arm: Description | None = None
        self._scene: ArmScene | None = None
        self._tool: Tool | None = None
        self._stiffness: Stiffness | None = None
        self._watching: Watching | None = None
        self._recorded: Recorded | None = None
        self._switches: Switches | None = None
        self._commissioning: Commissioning | None = None
        self._verdicts: Verdicts | None = None
        self._joints: list[str] = []
        self._name = ""
        self._newest: Any = None
        self._position: Array | None = None

    async def run(self, stop: Stop) -> None:
        """Show the system until a stop is requested."""
        building = asyncio.ensure_future(self._build())
        try:
            for picture in itertools.count():
                if stop.requested:
                    return
                self._desk.system.spin()
                if building.done():
                    building.result()
                if self._watching is not None:
                    self._show(picture, self._watching)
                if picture % _TELL_EVERY == 0:
                    self._report()
                await asyncio.sleep(_PERIOD)
        finally:
            building.cancel()
            if self._commissioning is not None:
                await self._commissioning.close()
            if self._verdicts is not None:
                await self._verdicts.close()

    # Building.

    async def _build(self) -> None:
        """Wait for the controller, and add the parts of the page."""
        desk, gui = self._desk, self._desk.server.gui
        described = await _until_answered(lambda: desk.system.described("controller"))
        values = {each.name: each.value for each in described}
        self._joints = list(values["joints"])
        await self._add_arm(values)
        tabs = gui.add_tab_group()
        watch, control = tabs.add_tab("Watch"), tabs.add_tab("Controller")
        self._watching = Watching(desk, self._joints, self._units, watch)
        with control:
            self._saved = Saved(desk, lambda: self._forms["controller"].values)
            again = "configure and activate the controller; if it does not run, start it again"
            desk.button("Activate", self._activate, again, moves=True, color="green")
            desk.button("Deactivate", self._deactivate, "the controller publishes a last, safe torque")
            reset = "follow the reference again after a fault (~/reset_fault)"
            desk.button("Reset the fault", self._reset, reset, moves=True)
            self._switches = Switches(desk)
        self._forms["controller"] = NodeForms(desk, "controller", control)
        with control:
            self._stiffness = Stiffness(desk, self._forms["controller"])
        await _until_answered(self._forms["controller"].build)
        if desk.system.has("trajectory") or (desk.nodes is not None and "trajectory" in desk.nodes.parameters):
            await self._add_motion(tabs)
        if desk.system.simulated:
            disturb = tabs.add_tab("Disturb")
            with disturb:
                Pushing(desk)
                Carrying(desk)
                if desk.nodes is not None:
                    Breaking(desk)
            self._forms["simulator"] = NodeForms(desk, "simulator", disturb)
            await _until_answered(self._forms["simulator"].build)
        with tabs.add_tab("Verdicts"):
            self._verdicts = Verdicts(desk, lambda: self._forms["controller"].values)
        with tabs.add_tab("Commission"):
            withdrawal = Withdrawal(desk, self._forms)
            self._commissioning = Commissioning(desk, withdrawal, self._name, lambda: self._forms["controller"].values)
        with tabs.add_tab("Keep"):
            self._recorded = Recorded(desk, self._recording, self._values)
        while "trajectory" not in self._forms:  # It may be discovered, or started, later.
            await asyncio.sleep(_LOOK)
            if desk.system.has("trajectory"):
                await self._add_motion(tabs)

    async def _add_motion(self, tabs: GuiTabGroupHandle) -> None:
        """Add the controls of the trajectory node, once it answers."""
        motion = tabs.add_tab("Motion")
        with motion:
            moving = Moving(self._desk, self._joints, np.zeros(len(self._joints)))
            if self._arm is not None:
                self._tool = Tool(self._desk, self._arm)
        if self._watching is not None:
            self._watching.moving = moving
        self._forms["trajectory"] = NodeForms(self._desk, "trajectory", motion)
        await _until_answered(self._forms["trajectory"].build)

    async def _add_arm(self, values: Mapping[str, Any]) -> None:
        known = {parameter.name: values[parameter.name] for parameter in description_schema(values)}
        robot = find_robot(known)
        self._name = robot.name
        self._units = joint_units(robot.slides, len(self._joints))
        try:
            arm = self._arm = find_description(known)
        except ParameterError as error:
            self._desk.system.note(str(error))
            return
        source = str(known.get(DESCRIPTION.name, ""))
        found = await asyncio.to_thread(solids_of, arm, source)  # It reads files.
        self._scene = ArmScene(self._desk.server.scene, arm, found)
        camera = self._desk.server.initial_camera
        camera.position, camera.look_at = self._scene.camera
        camera.up = (0.0, 0.0, 1.0)

    def _values(self) -> dict[str, Mapping[str, Any]]:
        return {node: forms.values for node, forms in self._forms.items()}

    # Actions.

    # A change that starts a node again is over before it is asked whether the node runs.

    async def _start_again(self, node: str) -> None:
        async with self._desk.changing:
            if node in self._forms:
                await self._forms[node].start_again()
            elif self._recorded is not None and node == "recorder":
                await self._recorded.start()
            elif self._desk.nodes is not None and node in self._desk.nodes.parameters:
                await self._desk.nodes.start_again(node)
                self._desk.system.lives.begin(node)
                self._desk.system.note(f"{node} started again")

    async def _activate(self) -> None:
        self._desk.require_free()
        async with self._desk.changing:
            nodes = self._desk.nodes
            if nodes is not None and not nodes.runs("controller"):
                await self._forms["controller"].start_again()
            else:
                await self._desk.system.activate("controller")
                self._desk.system.note("controller activated")

    async def _deactivate(self) -> None:
        await self._desk.system.deactivate("controller")
        self._desk.system.note("controller deactivated")

    async def _reset(self) -> None:
        await self._desk.system.trigger("controller/reset_fault")
        self._desk.system.note("fault reset")

    # Showing.

    def _show(self, picture: int, watching: Watching) -> None:
        batch = self._desk.system.states()
        if batch is not None:
            self._newest = batch.newest
            if list(batch.newest.name) == self._joints:
                watching.add(batch)
        changed, self._desk.system.changed = self._desk.system.changed, []
        for node, values in changed:
            if node in self._forms:
                self._forms[node].follow(values)
        self._move(batch)
        if picture % _DRAW_EVERY == 0:
            watching.draw()
        if picture % _TELL_EVERY == 0:
            watching.show()

    def _report(self) -> None:
        """Update the texts."""
        self._strip.look()
        self._read_returned()
        self._status.show(self._newest, self._name)
        self._strip.show()
        self._undo.show()
        if self._switches is not None:
            self._switches.show(self._newest)
        if self._stiffness is not None:
            self._stiffness.show()
        if self._recorded is not None:
            self._recorded.show()
        if self._commissioning is not None:
            self._commissioning.show()
        if self._verdicts is not None:
            self._verdicts.show()

    def _read_returned(self) -> None:
        """A node that was away and is back may have other parameters."""
        lives = self._desk.system.lives
        for node, forms in self._forms.items():
            if lives.condition(node) is Condition.SILENT:
                self._lost.add(node)
            elif node in self._lost and lives.condition(node) is Condition.ALIVE:
                self._lost.discard(node)
                self._desk.system.note(f"{node} is alive again")
                self._desk.run(forms.read_again())

    def _move(self, batch: Batch | None) -> None:
        """Show the arm: as the controller sees it, or as it is measured while the controller is silent."""
        reference, effort = None, np.full(len(self._joints), np.nan)  # Unknown while no message has them.
        if batch is not None:
            last = batch.values[-1]
            self._position = last[Signal.POSITION]
            reference, effort = self._position - last[Signal.POSITION_ERROR], last[Signal.EFFORT]
        elif self._desk.system.silence > OLD:
            measured = self._desk.system.position(self._joints)
            self._position = self._position if measured is None else measured
        else:
            return
        if self._scene is not None and self._position is not None:
            self._scene.show(self._position, reference, effort)
            if self._tool is not None:
                self._tool.show(self._position, reference)


async def _until_answered(request: Callable[[], Awaitable[_Answer]]) -> _Answer:
    """Repeat a request until the node answers: it may still be starting."""
    while True:
        try:
            return await request()
        except RefusedError:
            await asyncio.sleep(_PERIOD)
