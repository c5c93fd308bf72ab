"""The nodes that ``./pidtsm live`` and ``./pidtsm nodes start`` start, and the page may break and start again."""

import asyncio
import signal
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from pidtsm_core.experiment import PRACTICAL, Experiment
from pidtsm_core.experiment.definition import MEASUREMENT, Purpose
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.experiment.node_settings import resolve_nodes
from pidtsm_core.parameters import ParameterError, Value
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.runs.runner import Processes, check_security, how_ended, node_parameters

_LISTENING = {"simulator": 2, "controller": 1, "trajectory": 1}
"""Number of subscribers that each node waits for at the start; a page need not be one of them."""
OPERATION = Purpose(
    {**MEASUREMENT.defaults, "controller": {**MEASUREMENT.defaults["controller"], "activation.blend": 0.8}},
    usual=PRACTICAL,
)
"""A simulated system that somebody operates: a controller that is started again approaches its reference, and whoever
watches also pushes, and adds noise."""
_CHOICES = {"controller": ("law", "estimator"), "trajectory": ("reference",)}
"""By node, the groups whose parameters depend on the choice of ``GROUP.name``."""

Surroundings: TypeAlias = Callable[[str], dict[str, str]]
"""Environment variables of a node's process, by its name."""


def live_parameters(experiment: Experiment) -> dict[str, dict[str, Value]]:
    """Every parameter of every node of a system for `OPERATION`; it has no end.

    Raises:
        UsageError: a parameter works in a rollout only.
    """
    return node_parameters(experiment, "realtime", _LISTENING, duration=0.0)


class Nodes:
    """Nodes in real time, each in its process, until the end of the block.

    Attributes:
        parameters: by node, what each was started with last.
    """

    def __init__(
        self,
        parameters: Mapping[str, Mapping[str, Value]],
        folder: Path,
        surroundings: Surroundings,
        words: Sequence[str],
    ) -> None:
        """Nothing is started.

        Args:
            parameters: of each node, complete.
            folder: for parameter files and logs.
            surroundings: returns the environment variables of a node's process.
            words: arguments of ROS for each process, such as ``-r __ns:=/left``.

        Raises:
            UsageError: security is requested but not available.
        """
        self.parameters = {node: dict(values) for node, values in parameters.items()}
        check_security(self.parameters)
        self._folder, self._surroundings, self._words = folder, surroundings, list(words)
        self._processes = Processes()
        self._frozen: set[str] = set()
        self._restarting = asyncio.Lock()

    def __enter__(self) -> "Nodes":
        return self

    def start_all(self) -> "Nodes":
        """Start every node."""
        for node in self.parameters:
            self.start(node)
        return self

    def __exit__(self, *_: object) -> None:
        for node in filter(self.runs, list(self._frozen)):
            self.thaw(node)
        self._processes.__exit__(None, None, None)

    def start(self, node: str) -> None:
        """Start a node that does not run."""
        file = self._folder / f"{node}.yaml"
        file.write_text(ros_parameters(node, self.parameters[node]), encoding="utf-8")
        arguments = ["--params-file", str(file), *self._words]
        self._processes.start(node, arguments, self._surroundings(node), self._folder / f"{node}.log")

    def runs(self, node: str) -> bool:
        """Whether the process of a node runs."""
        process = self._processes.running.get(node)
        return process is not None and process.process.poll() is None

    def ended(self, node: str) -> str:
        """How the process of a node has ended; empty: it runs, or is being replaced."""
        process = self._processes.running.get(node)
        code = None if process is None else process.process.poll()
        return "" if code is None else how_ended(code)

    def last_words(self, node: str) -> str:
        """The last lines that a node has logged."""
        process = self._processes.running.get(node)
        return process.tail() if process else ""

    def suspended(self, node: str) -> bool:
        """Whether the page has suspended the process of a node."""
        return node in self._frozen

    def kill(self, node: str) -> None:
        """End a process at once, as a crash does.

        Raises:
            RefusedError: it does not run.
        """
        self._process(node).kill()
        self._frozen.discard(node)

    def freeze(self, node: str) -> None:
        """Suspend a process, as if it hung.

        Raises:
            RefusedError: it does not run.
        """
        self._process(node).send_signal(signal.SIGSTOP)
        self._frozen.add(node)

    def thaw(self, node: str) -> None:
        """Let a suspended process go on.

        Raises:
            RefusedError: it does not run.
        """
        self._process(node).send_signal(signal.SIGCONT)
        self._frozen.discard(node)

    def _process(self, node: str) -> Any:
        if not self.runs(node):
            raise RefusedError(f"{node} does not run")
        return self._processes.running[node].process

    async def end(self, node: str) -> None:
        """End a node, which deactivates itself before; `start_again` starts it."""
        async with self._restarting:
            await self._end(node)

    async def start_again(self, node: str) -> None:
        """Start a node that has ended, with the same arguments; the others go on.

        Raises:
            RefusedError: it runs.
        """
        async with self._restarting:
            if self.runs(node):
                raise RefusedError(f"{node} runs; only a node that has ended can be started again")
            await self._end(node)
            self.start(node)

    async def restart(self, node: str, changes: Mapping[str, Any] | None = None) -> None:
        """Start a node again with changed parameters, after it has been deactivated and has ended, if it runs.

        A new law, estimator or reference begins with the defaults of its own parameters. If the simulator changes, all
        nodes are started again.

        Raises:
            RefusedError: a value is invalid; nothing is changed.
        """
        async with self._restarting:  # Two browsers may want it at the same time.
            changed = self._checked(node, changes or {})
            together = list(self.parameters) if node == "simulator" else [node]
            for each in together:
                await self._end(each)
            self.parameters = changed
            for each in together:
                self.start(each)

    def _checked(self, node: str, changes: Mapping[str, Any]) -> dict[str, dict[str, Value]]:
        """The parameters of all nodes with these changes."""
        before = self.parameters[node]
        kept = dict(before)
        for group in _CHOICES.get(node, ()):
            choice = f"{group}.name"
            if changes.get(choice, before[choice]) != before[choice]:
                kept = {name: value for name, value in kept.items() if not name.startswith(f"{group}.")}
        settings: dict[str, dict[str, Any]] = {each: dict(values) for each, values in self.parameters.items()}
        settings[node] = {**kept, **changes}
        try:
            known = {parameter.name for parameter in NODE_SCHEMAS[node](settings[node])}
            settings[node] = {k: v for k, v in settings[node].items() if k in known or k in changes}
            return resolve_nodes(NODE_SCHEMAS, settings)
        except ParameterError as error:
            raise RefusedError(str(error)) from None

    def remember(self, node: str, values: Mapping[str, Value]) -> None:
        """Start a node with these values next time: they were changed while it runs."""
        self.parameters[node] = {
            **self.parameters[node],
            **{k: v for k, v in values.items() if k in self.parameters[node]},
        }

    async def _end(self, node: str) -> None:
        """Interrupt a node, which then deactivates itself, and wait for it; kill it if it does not end."""
        if node in self._frozen and self.runs(node):
            self.thaw(node)
        self._frozen.discard(node)
        process = self._processes.running.pop(node, None)
        if process is None:
            return
        process.interrupt()
        await asyncio.to_thread(process.wait)
