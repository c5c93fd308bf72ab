"""What has been changed on the way: a history that can be undone, and which change is large."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_experiments.live.parameters import shown

LARGE = 3.0
"""A change by more than this factor, in either direction, is large."""

_LISTED = 3
"""Values of a step that are listed."""


def is_large(before: Any, after: Any) -> bool:
    """Whether a change needs a confirmation on a real arm.

    A number: if it changes by more than the factor `LARGE` in either direction, from or to zero, or its sign. Numbers
    of several joints: if one of them does; a single number stands for every joint. Anything else has no factor, so each
    change counts.
    """
    if not _numeric(before) or not _numeric(after):
        return _plain(before) != _plain(after)
    old, new = np.atleast_1d(np.asarray(before, dtype=float)), np.atleast_1d(np.asarray(after, dtype=float))
    if old.size != new.size and 1 not in (old.size, new.size):
        return True
    old, new = np.broadcast_arrays(old, new)
    near = (np.abs(new) <= LARGE * np.abs(old)) & (np.abs(old) <= LARGE * np.abs(new))
    return not bool(((old == new) | (near & (np.sign(old) == np.sign(new)))).all())


def _numeric(value: Any) -> bool:
    values = value if isinstance(value, (list, tuple)) else [value]
    return len(values) > 0 and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, (list, tuple)) else value


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The values that differ, before and after; a name that only one of them has appears only there."""
    names = [n for n in {**before, **after} if n not in before or n not in after or not same(before[n], after[n])]
    return {n: before[n] for n in names if n in before}, {n: after[n] for n in names if n in after}


def same(one: Any, other: Any) -> bool:
    """Whether two values of a parameter are equal; 1 and True are not."""
    return isinstance(one, bool) == isinstance(other, bool) and _plain(one) == _plain(other)


@dataclass(frozen=True)
class Step:
    """Values of a node that have changed together.

    Attributes:
        at: time of day.
        node: its name.
        before, after: the values, by name.
        by: who has changed them, if it was not the page; empty: the page.
    """

    at: str
    node: str
    before: Mapping[str, Any]
    after: Mapping[str, Any]
    by: str = ""

    def __str__(self) -> str:
        # A choice, such as of the law, comes before the parameters that come and go with it.
        names = sorted({**self.before, **self.after}, key=lambda name: not name.endswith(".name"))
        text = "; ".join(described(name, self.before.get(name), self.after.get(name)) for name in names[:_LISTED])
        text += f"; and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
        return f"{self.node} {text}" + (f" ({self.by})" if self.by else "")


def described(name: str, before: Any, after: Any) -> str:
    """One change in words."""
    return f"{name}: {_or_none(before)} → {_or_none(after)}"


def _or_none(value: Any) -> str:
    return "none" if value is None else shown(value)


class Changes:
    """Every change since the page began, the oldest first; those that were undone are gone.

    Attributes:
        steps: the changes.
    """

    def __init__(self, clock: Callable[[], str] = lambda: time.strftime("%H:%M:%S")) -> None:
        """Args: clock: returns the time of day."""
        self.steps: list[Step] = []
        self._clock = clock

    def record(self, node: str, before: Mapping[str, Any], after: Mapping[str, Any], by: str = "") -> None:
        """Add what differs between the values before and after, if anything does."""
        old, new = differences(before, after)
        if old or new:
            self.steps.append(Step(self._clock(), node, old, new, by))

    def remove(self, steps: Iterable[Step]) -> None:
        """These have been undone."""
        gone = {id(step) for step in steps}
        self.steps = [step for step in self.steps if id(step) not in gone]

    def back(self, count: int) -> dict[str, dict[str, Any]]:
        """The values, by node and name, with which the last `count` steps are undone."""
        values: dict[str, dict[str, Any]] = {}
        for step in reversed(self.steps[len(self.steps) - count :]):
            values[step.node] = {**values.get(step.node, {}), **step.before}
        return values
