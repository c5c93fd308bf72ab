"""Limits that have been computed (``limits.yaml``)."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml


def known_limit(robot: str) -> list[float] | None:
    """Smallest RMSE of each joint (rad) in the scenario on which the arm is scored; None: it is not known."""
    row = _limits().get(robot)
    return None if row is None else list(row["rmse"])


@cache
def _limits() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("limits.yaml").read_text(encoding="utf-8"))
    return content
