"""The nodes of pidtsm that run in the user's domain, and what each does."""

import asyncio
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters

from pidtsm_core.signals import Mode
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.system import System
from pidtsm_experiments.live.words import fault, mode
from pidtsm_experiments.operate.attached import FOUND_WITHIN
from pidtsm_msgs.msg import ControllerState

_MARKS = {"controller": "law.name", "trajectory": "reference.name", "simulator": "robot.description"}
"""By name of a node, a parameter that a foreign node of the same name lacks."""
_SETTLE = 3.2
"""s in which the others are discovered, after the first: with profiles other than ours, one that misses them discovers
them 3 s later."""
_REPORT_WITHIN = 1.5
"""s; nodes report once a second."""
_POLL = 0.05  # s


@dataclass(frozen=True)
class Row:
    """What is known of one node.

    Attributes:
        node: full name.
        lifecycle: its state in lower case; empty: it does not answer.
        status: what it does, or why it does not answer.
        mode: of a controller that runs: following, holding, stopped or freedrive; empty: none.
        fault: why a controller has stopped; empty: it has not.
        age: time since its last message, s; None: none has arrived.
    """

    node: str
    lifecycle: str
    status: str
    mode: str = ""
    fault: str = ""
    age: float | None = None


class _Watched:
    """The nodes of one namespace."""

    def __init__(self, system: System, nodes: Iterable[str]) -> None:
        self.system, self.nodes = system, sorted(nodes)
        self.newest: ControllerState | None = None
        self._reported: set[str] = set()

    def look(self) -> bool:
        """Take what has arrived; whether every node has reported."""
        self.system.spin()
        batch = self.system.states()
        self.newest = self.newest if batch is None else batch.newest
        self._reported |= {node for node in self.nodes if self.system.report(node)}
        # Whether the arm is held on request is in the report alone.
        known = self.newest is not None and self.newest.mode != Mode.HOLDING
        return self._reported | ({"controller"} if known else set()) >= set(self.nodes)

    async def row(self, node: str) -> Row | None:
        """What is known of a node; None: it is not one of pidtsm."""
        name = f"{self.system.namespace.rstrip('/')}/{node}"
        try:
            marked = await self.system.call(
                GetParameters, f"{node}/get_parameters", GetParameters.Request(names=[_MARKS[node]])
            )
            if [value.type for value in marked.values] != [ParameterType.PARAMETER_STRING]:
                return None
            answer = await self.system.call(GetState, f"{node}/get_state", GetState.Request())
        except RefusedError as error:
            return Row(name, "", str(error))
        lifecycle, age = str(answer.current_state.label), self.system.lives.age(node)
        if node != "controller":
            return Row(name, lifecycle, self.system.report(node) or "no report yet", age=age)
        newest, active = self.newest, lifecycle == "active"
        status = mode(self.system.known(newest)).text
        if newest is None or not active:
            return Row(name, lifecycle, status, age=age)
        return Row(name, lifecycle, status, _mode(newest.mode), fault(newest), age)


def _mode(number: int) -> str:
    with suppress(ValueError):
        return Mode(number).name.lower()
    return str(number)


async def rows(root: System, namespace: str | None) -> list[Row]:
    """The nodes of pidtsm, by name.

    Args:
        root: any system in the domain.
        namespace: the only one to look into; None: all.
    """
    end, settled = time.monotonic() + FOUND_WITHIN, False
    while time.monotonic() < end and not _complete(names := _names(root, namespace)):
        if names and not settled:
            settled = True
            end = time.monotonic() + _SETTLE
        await asyncio.sleep(_POLL)
    with _watched(_names(root, namespace)) as watched:
        end = time.monotonic() + _REPORT_WITHIN
        complete = False
        while not complete and time.monotonic() < end:
            looks = [each.look() for each in watched]
            complete = all(looks)
            await asyncio.sleep(_POLL)
        spinning = asyncio.ensure_future(_spin(watched))
        try:
            pending = [each.row(node) for each in watched for node in each.nodes]
            return [row for row in await asyncio.gather(*pending) if row is not None]
        finally:
            spinning.cancel()


def _names(root: System, namespace: str | None) -> dict[str, set[str]]:
    """By namespace, the nodes that may be ours."""
    found: dict[str, set[str]] = {}
    for name, space in root.graph():
        if name in _MARKS and namespace in (None, space):
            found.setdefault(space, set()).add(name)
    return found


def _complete(names: dict[str, set[str]]) -> bool:
    """Whether no more nodes can be expected."""
    return bool(names) and all(found == set(_MARKS) for found in names.values())


@contextmanager
def _watched(names: dict[str, set[str]]) -> Iterator[list[_Watched]]:
    with ExitStack() as stack:
        watched = []
        for space in sorted(names):
            system = System(space, "pidtsm_list")
            stack.callback(system.close)
            watched.append(_Watched(system, names[space]))
        yield watched


async def _spin(watched: Iterable[_Watched]) -> Any:
    while True:
        for each in watched:
            each.look()
        await asyncio.sleep(_POLL)
