"""Pairs instead of all combinations: for properties in which the members of several lists do not interact."""

from collections.abc import Sequence
from typing import Any

import pytest


def paired(names: str, *lists: Sequence[Any]) -> pytest.MarkDecorator:
    """Parametrise with the first of each list, the second of each, and so on: every member occurs.

    Args:
        names: of the parameters, with commas between them, in the order of the lists.
        lists: the members of each; those of a shorter list come again from its beginning.
    """
    count = max(map(len, lists))
    rows = [tuple(each[i % len(each)] for each in lists) for i in range(count)]
    return pytest.mark.parametrize(names, rows, ids=["-".join(map(_named, row)) for row in rows])


def _named(member: Any) -> str:
    if isinstance(member, dict):
        return "-".join(map(str, member.values()))
    return str(getattr(member, "name", member))
