"""Common parts of the members of a family (surfaces, reaching laws, estimators ...)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, Value, joint_array

SLOTS = 8
"""Largest number of parameters of a member per joint, and of its state variables."""


@dataclass(frozen=True)
class Member:
    """One member of a family: name, summary, parameters and compiled function.

    Attributes:
        name: the name by which users choose it.
        summary: one sentence with its source.
        parameters: at most `SLOTS`; their order is the order in which the compiled function reads them.
    """

    name: str
    summary: str
    parameters: tuple[Parameter, ...]

    def pack(self, values: Mapping[str, Value], group: str, joints: int) -> Array:
        """Parameter values as the compiled function reads them, shape (joints, SLOTS), order of `parameters`."""
        packed = np.zeros((joints, SLOTS))
        for column, parameter in enumerate(self.parameters):
            packed[:, column] = joint_array(values[f"{group}.{parameter.name}"], joints)
        return packed


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Member = TypeVar("_Member", bound=_Named)


class Family(Generic[_Member]):
    """Members by name, in an order."""

    def __init__(self, *members: _Member) -> None:
        """Args: members: in order. Raises: ValueError: two members have the same name."""
        self.members = members
        self.names: tuple[str, ...] = tuple(m.name for m in members)
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"two members of a family share a name: {self.names}")

    @classmethod
    def of(cls, kind: type[_Member], namespace: Mapping[str, object]) -> "Family[_Member]":
        """Collect the members of a kind from a module's names: a registry is a module that imports its members."""
        return cls(*(value for value in namespace.values() if isinstance(value, kind)))

    def __getitem__(self, name: str) -> _Member:
        return self.members[self.names.index(name)]

    def index(self, name: str) -> int:
        return self.names.index(name)
