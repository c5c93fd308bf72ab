"""Takes the controller of a system away for a while, and brings it back."""

import asyncio
import time
from collections.abc import Mapping
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.forms import NodeForms
from pidtsm_studies.commissioning.simulated import TIMEOUT

_NODE, _COMMANDS = "controller", "joint_commands"
_GONE_WITHIN, _POLL = 20.0, 0.1
"""s; a process that has ended is discovered to be away."""


class Withdrawal:
    """The controller is away while the desk is occupied."""

    def __init__(self, desk: Desk, forms: Mapping[str, NodeForms]) -> None:
        self._desk, self._forms = desk, forms
        self._patience: Mapping[str, Any] = {}
        """What the simulator had instead of `TIMEOUT`."""

    async def withdraw(self, why: str) -> None:
        """Have nobody command the arm; if the page has started the controller, its process ends.

        Args:
            why: what the controller has to stay away for.

        Raises:
            RefusedError: the controller does not give way, or somebody else commands the arm.
        """
        self._desk.require_free()
        async with self._desk.changing:
            if self._desk.nodes is not None:
                await self._desk.nodes.end(_NODE)
            elif self._desk.system.has(_NODE):
                await self._leave(State.PRIMARY_STATE_ACTIVE, Transition.TRANSITION_DEACTIVATE)
                await self._leave(State.PRIMARY_STATE_INACTIVE, Transition.TRANSITION_CLEANUP)
            self._desk.occupied = why
            await self._close_brakes_soon()
            end = time.monotonic() + _GONE_WITHIN
            while self._desk.system.publishers(_COMMANDS):
                if time.monotonic() > end:
                    self._desk.occupied = ""
                    raise RefusedError(f"somebody publishes {_COMMANDS}; end it first")
                await asyncio.sleep(_POLL)

    async def _close_brakes_soon(self) -> None:
        """Have the brakes of a simulated arm close as those of a real one do when commands cease."""
        simulator = self._forms.get("simulator")
        if simulator is not None and not self._patience:
            self._patience = {name: simulator.values[name] for name in TIMEOUT if name in simulator.values}
            await simulator.put(TIMEOUT, recorded=False)

    async def _leave(self, state: int, transition: int) -> None:
        call = self._desk.system.call
        if (await call(GetState, f"{_NODE}/get_state", GetState.Request())).current_state.id != state:
            return
        request = ChangeState.Request(transition=Transition(id=transition))
        if not (await call(ChangeState, f"{_NODE}/change_state", request)).success:
            raise RefusedError(f"{_NODE} does not give way; end it")

    async def bring_back(self, changes: Mapping[str, Any] | None = None) -> None:
        """Start the controller again, if the page had started it; somebody else's can be activated from now on.

        The reference goes to where the arm has been left, and waits there.

        Args:
            changes: parameters that change; None: none.

        Raises:
            RefusedError: it does not start with them.
        """
        self._desk.occupied = ""
        if self._patience:
            await self._forms["simulator"].put(self._patience, recorded=False)
            self._patience = {}
        await self._bring_the_reference()
        if self._desk.nodes is None:
            return
        async with self._desk.changing:
            if changes is not None:
                await self._forms[_NODE].restart(changes)
            elif not self._desk.nodes.runs(_NODE):
                await self._forms[_NODE].start_again()

    async def _bring_the_reference(self) -> None:
        if not self._desk.system.has("trajectory"):
            return
        try:
            await self._desk.system.trigger("trajectory/go_to_arm")
        except RefusedError as error:
            self._desk.system.note(f"the reference stays where it is: {error}")
