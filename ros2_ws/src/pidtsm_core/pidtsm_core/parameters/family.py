"""Common parts of the members of a family (surfaces, reaching laws, estimators ...)."""

import keyword
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import MemberError, MemberWarning, UsageError
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


def check_parameters(what: str, parameters: Iterable[Parameter], most: int = SLOTS) -> None:
    """Check the parameters of a member from outside.

    Raises:
        MemberError: there are too many, two share a name, a name is no identifier, or a default is not allowed.
    """
    given = tuple(parameters)
    names = [parameter.name for parameter in given]
    if len(given) > most:
        raise MemberError(f"{what}: it has {len(given)} parameters; at most {most} are possible")
    for name in names:
        if not name.isidentifier() or names.count(name) > 1:
            raise MemberError(f"{what}: parameter {name!r} occurs twice, or is not made of letters, digits and _")
    for parameter in given:
        try:
            parameter.check(parameter.default, 1)
        except UsageError as error:
            raise MemberError(f"{what}: the default of {error}") from None


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Member = TypeVar("_Member", bound=_Named)


class Origin(NamedTuple):
    """Where a member is from."""

    source: str  # name of a package or a module
    serial: str = ""  # of this registration; empty: processes find the member themselves, in an installed package


_OWN = Origin("pidtsm")


class Family(Generic[_Member]):
    """Members by name, in an order: those of this package, and behind them those from outside.

    Iterating gives the names, so a family can be the choices of a parameter, also of members that come later.
    Installed packages offer members as entry points of the group ``pidtsm.FAMILY``; they are found when the family is
    first asked for a name.

    Attributes:
        kind: type of the members.
        own: the members of this package.
    """

    def __init__(self, kind: type[_Member], title: str, *own: _Member, trial: str = "") -> None:
        """Make a family.

        Args:
            kind: type of the members.
            title: what a user calls the family, such as ``laws``.
            own: the members of this package, in order.
            trial: module whose function ``try_member`` tries a member from outside before it is first used, and raises
                `MemberError`; imported only then.

        Raises:
            ValueError: two members have the same name.
        """
        self.kind, self.title, self.own = kind, title, own
        self._members = {member.name: member for member in own}
        if len(self._members) != len(own):
            raise ValueError(f"two members of a family share a name: {[member.name for member in own]}")
        self._trial = trial
        self._tried: dict[str, _Member] = {}
        self._origins: dict[str, Origin] = {}
        self._searched = False

    @classmethod
    def of(cls, kind: type[_Member], title: str, namespace: Mapping[str, object], trial: str = "") -> "Family[_Member]":
        """Collect the members of a kind from a module's names: a registry is a module that imports its members."""
        return cls(kind, title, *(value for value in namespace.values() if isinstance(value, kind)), trial=trial)

    @property
    def members(self) -> tuple[_Member, ...]:
        return tuple(self._all().values())

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._all())

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self._all())

    def __contains__(self, name: object) -> bool:
        return name in self._all()

    def __getitem__(self, name: str) -> _Member:
        """The member of a name.

        Raises:
            KeyError: there is none.
            MemberError: it is from outside, and does not compile or returns nonsense.
        """
        member = self._all()[name]
        if name in self._origins and self._tried.get(name) is not member:
            self._try(member)
            self._tried[name] = member
        return member

    def _try(self, member: _Member) -> None:
        """Try a member from outside; see `MemberError`."""
        if not self._trial:
            return
        try:
            import_module(self._trial).try_member(member)
        except UsageError:
            raise
        except Exception as error:  # What its functions raise.
            raise MemberError(f"{self.kind.__name__} {member.name} raises {type(error).__name__}: {error}") from error

    def index(self, name: str) -> int:
        return self.names.index(name)

    def add(self, member: _Member, origin: "Origin") -> None:
        """Add a member from outside; from the same source, it replaces the one of its name.

        Args:
            member: the member.
            origin: where it is from.

        Raises:
            MemberError: its name is no identifier, or another source has it already.
        """
        where = f"{member.name} of {origin.source}"
        if not member.name.isidentifier() or keyword.iskeyword(member.name):
            raise MemberError(f"{where}: the name must have letters, digits and underscores only")
        if member.name in self._all():
            owner = self._origins.get(member.name, _OWN).source
            if owner != origin.source:
                raise MemberError(
                    f"{where}: {owner} already has a {self.kind.__name__} of this name; choose another one"
                )
        self._members[member.name], self._origins[member.name] = member, origin

    def replace(self, member: _Member, origin: "Origin") -> None:
        """As `add`, and try the member; if it cannot be used, the family stays as it was.

        Raises:
            MemberError: see `add` and `__getitem__`.
        """
        before = dict(self._all()), dict(self._origins)
        self.add(member, origin)
        try:
            self[member.name]
        except BaseException:
            self._members, self._origins = before
            raise

    def forget(self, name: str) -> None:
        """Remove a member from outside; what uses it goes on.

        Raises:
            KeyError: there is none of this name.
        """
        del self._origins[name], self._members[name]

    def outside(self) -> dict[str, "Origin"]:
        """Where the members from outside are from, by name."""
        return dict(self._origins)

    def _all(self) -> dict[str, _Member]:
        """The members by name, after those of installed packages have been found."""
        if not self._searched:
            self._searched = True  # First: the modules of the entry points may ask this family for names.
            for point in _offers().select(group=f"pidtsm.{self.title}"):
                self._load(point)
        return self._members

    def _load(self, point: EntryPoint) -> None:
        """Add what an entry point offers; what cannot be used is skipped with a warning."""
        package = point.dist.name if point.dist else point.value
        try:
            for member in offered(point.load(), self.kind):
                self.add(member, Origin(package))
        except Exception as error:  # Whatever its module raises.
            reason = f"{type(error).__name__}: {error}" if not isinstance(error, MemberError) else str(error)
            text = f"{package} offers a {self.kind.__name__} that cannot be used ({point.value}): {reason}"
            warnings.warn(text, MemberWarning, stacklevel=2)


@cache
def _offers() -> Any:
    """The entry points of all installed packages; to find them takes 30 ms."""
    return entry_points()


def offered(given: Any, kind: type[_Member]) -> Iterable[_Member]:
    """The members that an object is or contains.

    Raises:
        MemberError: it is neither a member of this kind nor an iterable of some.
    """
    members = [given] if isinstance(given, kind) or not isinstance(given, Iterable) else list(given)
    for member in members:
        if not isinstance(member, kind):
            raise MemberError(f"{member!r} is no {kind.__name__}")
    return members
