"""The forms of a node show what it has, whenever it changes."""

import asyncio
from collections.abc import Iterator

import pytest
from rcl_interfaces.msg import ParameterDescriptor
from viser import ViserServer

from pidtsm_experiments.live.changes import Changes
from pidtsm_experiments.live.forms import NodeForms
from pidtsm_experiments.live.parameters import Described


@pytest.fixture
def server() -> Iterator[ViserServer]:
    running = ViserServer("127.0.0.1", 0, verbose=False)
    yield running
    running.stop()


class _Node:
    """Answers with a value that has changed by the time the answer is read."""

    forms: NodeForms

    async def described(self, _node: str) -> list[Described]:
        self.forms.follow({"law.k1": 2.0})
        return [Described(ParameterDescriptor(name="law.k1"), 3.0)]


class _Desk:
    def __init__(self, server: ViserServer, system: _Node) -> None:
        self.server, self.system, self.nodes, self.changes = server, system, None, Changes()

    def run(self, _action: object) -> None:
        raise AssertionError


@pytest.mark.parametrize("read", [NodeForms.build, NodeForms.read_again])
def test_a_change_while_the_parameters_are_being_read_is_shown(server: ViserServer, read: object) -> None:
    node = _Node()
    desk = _Desk(server, node)
    node.forms = NodeForms(desk, "controller", server.gui.add_tab_group().add_tab("Controller"))  # type: ignore[arg-type]
    asyncio.run(read(node.forms))  # type: ignore[operator]
    assert node.forms.values == {"law.k1": 2.0}
    assert str(desk.changes.steps[-1]) == "controller law.k1: 3 → 2 (by another program)"
