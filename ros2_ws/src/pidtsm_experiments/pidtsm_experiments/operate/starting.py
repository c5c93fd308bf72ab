"""What ``./pidtsm nodes start`` starts, and how it watches that until it is interrupted."""

import asyncio
import os
import re
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL, Experiment
from pidtsm_core.experiment.definition import Purpose
from pidtsm_core.parameters import Value, names
from pidtsm_core.signals import Mode
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.lives import Condition
from pidtsm_experiments.live.nodes import Nodes, live_parameters
from pidtsm_experiments.live.system import System
from pidtsm_experiments.live.words import mode
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.stop import Stop

Show = Callable[[str], None]
"""Called with each line."""

REAL_ARM = Purpose({}, usual=PRACTICAL, nodes=("controller", "trajectory"))
"""Nodes for an arm of the user's."""
_STILL = {"reference.name": "minimum_jerk"}
"""The reference if no motion is given; its ends are where the arm is."""
_PERIOD = 0.05  # s
_LOOK = 0.5  # s between two looks into the graph
_WAIT = 2.0
"""s without joint states after which a line shows that they are awaited."""
_REST_WITHIN = 3.0
"""s for the arm to come to rest before the nodes end."""
_AGE = re.compile(r" \(\d+ s\)")
"""How long ago something was; that it gets older is no change."""
_AT_REST = 0.01
"""Largest desired velocity of an arm at rest, rad/s or m/s."""


class Start(NamedTuple):
    """What is started.

    Attributes:
        parameters: by node, complete.
        still: whether the reference is the place where the arm is when its first joint states arrive.
    """

    parameters: dict[str, dict[str, Value]]
    still: bool


def still_scenario() -> Experiment:
    """The motion if none is given: the arm stays where it is."""
    return Experiment("still", "", 1.0, {"simulator": {}, "controller": {}, "trajectory": dict(_STILL)})


def start_of(experiment: Experiment) -> Start:
    """The nodes of an experiment for `REAL_ARM` or `OPERATION`.

    Raises:
        UsageError: a parameter works in a rollout only.
    """
    motion = {name: value for name, value in experiment.settings["trajectory"].items() if name.startswith("reference.")}
    parameters = experiment.node_values({}) if experiment.purpose == REAL_ARM else live_parameters(experiment)
    return Start(parameters, motion == _STILL)


def surroundings(_node: str) -> dict[str, str]:
    """Environment variables of a node in the user's domain."""
    return {**os.environ, "PYTHONUNBUFFERED": "1"}


class Watch:
    """Starts nodes, shows what changes, and brings the arm to rest at the end."""

    def __init__(self, system: System, nodes: Nodes, start: Start, show: Show) -> None:
        """Args: show: called with each line."""
        self._system, self._nodes, self._start, self._show = system, nodes, start, show
        self._joints = names(start.parameters["controller"]["joints"])
        self._newest: ControllerState | None = None
        self._shown: dict[str, str] = {}
        self._arm_seen = False
        self._began = time.monotonic()

    async def run(self, stop: Stop) -> None:
        """Watch until a stop is requested.

        Raises:
            RunError: a process has ended by itself.
        """
        for node in self._start.parameters:
            if node != "trajectory" or not self._start.still:
                self._begin(node)
        looked = 0.0
        while not stop.requested:
            self._take()
            if time.monotonic() > looked:
                looked = time.monotonic() + _LOOK
                self._look()
            self._show_changes()
            await asyncio.sleep(_PERIOD)
        await self._rest(stop)

    def _begin(self, node: str) -> None:
        self._nodes.start(node)
        self._system.lives.begin(node)
        self._show(f"{node} starts")

    def _take(self) -> None:
        self._system.spin()
        batch = self._system.states()
        if batch is not None:
            self._newest = batch.newest
        if not self._arm_seen:
            self._see_arm()

    def _see_arm(self) -> None:
        """Look for the first joint states; begin the reference where the arm is."""
        if self._newest is not None and not self._start.still:
            self._arm_seen = True
            return
        position = self._system.position(self._joints)
        if position is None:
            if time.monotonic() > self._began + _WAIT:
                self._change("arm", f"waiting for joint_states of {', '.join(self._joints)} on {self._topic}")
            return
        self._arm_seen = True
        shown = ", ".join(f"{name} {q:.4f}" for name, q in zip(self._joints, position, strict=True))
        self._change("arm", f"first joint_states: {shown}")
        if self._start.still:
            where = tuple(np.asarray(position).tolist())
            self._nodes.remember("trajectory", {"reference.from": where, "reference.to": where})
            self._begin("trajectory")

    @property
    def _topic(self) -> str:
        return self._system.topic("joint_states")

    def _look(self) -> None:
        self._system.look()
        for node in self._start.parameters:
            ended = self._nodes.ended(node)
            if ended:
                raise RunError(f"{node} {ended}; its last lines:\n{self._nodes.last_words(node)}")

    def _show_changes(self) -> None:
        """Show what has changed."""
        if self._newest is not None or self._system.report("controller"):
            self._change("controller", mode(self._system.known(self._newest)).text)
        for node in self._system.lives:
            condition = self._system.lives.condition(node)
            if condition is Condition.ALIVE and self._shown.get(node, "") != condition.value:
                self._shown[node] = condition.value
                self._show(f"{node} is alive")
            elif condition is Condition.SILENT and self._shown.get(node) == Condition.ALIVE.value:
                self._shown[node] = condition.value
                self._show(self._system.lives.trouble(node))
        while self._system.events:
            _, text = self._system.events.pop()
            self._show(text)

    def _change(self, topic: str, text: str) -> None:
        """Show a text if it is not the last one about this topic."""
        key, lasting = f"/{topic}", _AGE.sub("", text)  # No name of a node has a slash.
        if self._shown.get(key) != lasting:
            self._shown[key] = lasting
            self._show(text)

    async def _rest(self, stop: Stop) -> None:
        """Bring an arm that follows to rest before the nodes end; another request to stop cuts it short."""
        newest = self._newest
        if newest is None or newest.mode != Mode.FOLLOWING or self._system.silence > _LOOK:
            return
        stop.requested = False
        self._show("bringing the arm to rest")
        held = asyncio.ensure_future(self._system.switch("controller/hold", on=True))
        end = time.monotonic() + _REST_WITHIN
        while time.monotonic() < end and not stop.requested:
            self._take()
            if held.done() and self._resting():
                break
            await asyncio.sleep(_PERIOD)
        held.cancel()
        try:
            await held
        except (RefusedError, asyncio.CancelledError) as error:
            self._show(f"the arm is not at rest: {error or 'no answer'}")

    def _resting(self) -> bool:
        state: Any = self._newest
        desired = np.asarray(state.velocity) - np.asarray(state.velocity_error)
        return bool(state.mode != Mode.FOLLOWING and np.abs(desired).max() < _AT_REST)


def described(start: Start) -> Mapping[str, str]:
    """What is started, for the first line: by node, what matters of it."""
    controller, trajectory = (start.parameters[node] for node in ("controller", "trajectory"))
    return {
        "controller": f"{controller['law.name']} for {', '.join(names(controller['joints']))}",
        "trajectory": "stays where the arm is" if start.still else str(trajectory["reference.name"]),
    }


def refuse_simulator(settings: list[str], engine: str | None) -> None:
    """Refuse options of a simulator that is not started.

    Raises:
        UsageError: there is one.
    """
    given = ["--engine"] if engine else [f"--set {each}" for each in settings if each.startswith("simulator.")]
    if given:
        raise UsageError(f"{given[0]} is for the simulated arm, which --plant starts; without it, the plant is yours")
