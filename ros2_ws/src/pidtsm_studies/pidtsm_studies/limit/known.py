"""Limits that have been computed (``limits.yaml``)."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml


def known_limit(robot: str) -> list[float] | None:
    """Smallest RMSE of each joint (rad) in the scenario on which the arm is scored; None: it is not known."""
    row = _limits().get(robot)
    return None if row is None else list(row["rmse"])


def above_limit(robot: str, rmse: Sequence[float]) -> str:
    """By how much the RMSE of each joint (rad) exceeds what any controller can reach; empty if that is not known."""
    limit = known_limit(robot)
    if limit is None:
        return ""
    return ", ".join(f"{100.0 * (a / b - 1.0):+.1f} %" for a, b in zip(rmse, limit, strict=True))


@cache
def _limits() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("limits.yaml").read_text(encoding="utf-8"))
    return content
