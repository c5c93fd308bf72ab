"""The definition of a run, with its parameters: `Experiment`."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

from pidtsm_core.experiment.node_parameters import COMPLETE_SCHEMAS, NODE_ONLY, check_node
from pidtsm_core.experiment.node_settings import naming, resolve_nodes
from pidtsm_core.parameters import ParameterError, Value, names
from pidtsm_core.parameters.files import NODES


class Purpose(NamedTuple):
    """What an experiment is made for.

    Attributes:
        defaults: defaults that differ from those of the nodes, by node.
        usual: parameter set of the default law if none is named; empty: that of an arm from a file only.
        nodes: whose parameters are checked.
    """

    defaults: Mapping[str, Mapping[str, Value]]
    usual: str = ""
    nodes: tuple[str, ...] = NODES


MEASUREMENT = Purpose(
    {
        "simulator": {"command.timeout": 1.0},
        "controller": {"activation.blend": 0.0, "watchdog.state_stop": 1.0},
    }
)
"""A run or a rollout: it measures the law from its first sample on, and no watchdog should end it."""


@dataclass(frozen=True)
class Experiment:
    """Definition of a run. It does not change; `make_experiment` and `dataclasses.replace` vary it.

    Attributes:
        scenario: name or file name of the scenario.
        law: name of the control law.
        duration: s.
        settings: parameters that differ from the defaults, by node.
        files: source file of each setting, by ``NODE.PARAMETER``, for error messages.
        purpose: what it is made for.
    """

    scenario: str
    law: str
    duration: float
    settings: Mapping[str, Mapping[str, Any]]
    files: Mapping[str, str] = field(default_factory=dict)
    purpose: Purpose = MEASUREMENT

    def __post_init__(self) -> None:
        settings = {**{node: {} for node in NODES}, **self.settings}
        unchangeable = MappingProxyType({node: MappingProxyType(dict(given)) for node, given in settings.items()})
        object.__setattr__(self, "settings", unchangeable)  # Changes would not be checked.

    def __reduce__(self) -> tuple[Any, ...]:
        settings = {node: dict(given) for node, given in self.settings.items()}
        return Experiment, (self.scenario, self.law, self.duration, settings, self.files, self.purpose)

    @property
    def event_time(self) -> float | None:
        """Time at which the plant changes during the run (s), for the metrics; None if it does not."""
        simulator = self.settings["simulator"]
        if not simulator.get("payload.mass", 0.0):
            return None
        time = float(simulator.get("payload.time", 0.0))
        return time if 0.0 < time < self.duration else None

    @property
    def values(self) -> dict[str, dict[str, Value]]:
        """A copy of every parameter that affects a torque, by node, checked.

        Raises:
            ParameterError: an unknown parameter or an invalid value; the message contains file, node and parameter.
        """
        only = {node: {p.name for p in parameters} for node, parameters in NODE_ONLY.items()}
        return {
            node: {name: value for name, value in values.items() if name not in only[node]}
            for node, values in self._complete.items()
        }

    def node_values(self, defaults: Mapping[str, Mapping[str, Value]]) -> dict[str, dict[str, Value]]:
        """Every parameter of every node, checked.

        Args:
            defaults: of parameters that only nodes have, by node, where they differ from those of the nodes.

        Raises:
            ParameterError: see `values`, or a value that works in a rollout only.
        """
        found = {}
        for node, complete in self._complete.items():
            joints, only = len(names(complete["joints"])), {p.name: p for p in NODE_ONLY[node]}
            others = {name: value for name, value in defaults.get(node, {}).items() if name not in self.settings[node]}
            with self._naming_files(), naming(node):
                checked = {name: only[name].check(value, joints) for name, value in others.items()}
                found[node] = {**complete, **checked}
                check_node(node, found[node])
        return found

    @cached_property
    def _complete(self) -> dict[str, dict[str, Value]]:
        """All parameters, also those that only nodes have."""
        nodes = self.purpose.nodes
        with self._naming_files():
            for node, given in self.settings.items():
                _check_integers(node, given)
            settings = {
                node: {**self.purpose.defaults.get(node, {}), **given}
                for node, given in self.settings.items()
                if node in nodes or node not in NODES  # An unknown one is refused.
            }
            return resolve_nodes({node: COMPLETE_SCHEMAS[node] for node in nodes}, settings)

    @contextmanager
    def _naming_files(self) -> Iterator[None]:
        """Add the file of a refused parameter to the message."""
        try:
            yield
        except ParameterError as error:
            if file := self.files.get(error.parameter):
                raise ParameterError(f"{file}: {error}", error.parameter) from None
            raise


def _check_integers(node: str, given: Mapping[str, Any]) -> None:
    """Check that integers are in the range of numbers: those of a file may have any number of digits.

    Raises:
        ParameterError: one is not.
    """
    for name, value in given.items():
        for each in value if isinstance(value, (list, tuple)) else (value,):
            if isinstance(each, int) and abs(each) > sys.float_info.max:
                raise ParameterError(f"{node}.{name}: an integer is too large for a number", f"{node}.{name}")
