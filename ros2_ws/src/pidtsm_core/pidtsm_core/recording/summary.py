"""The file metrics.json."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_metrics(values: Mapping[str, Any], path: Path) -> None:
    """Write metrics as JSON, atomically: the file is never incomplete.

    Args:
        values: as returned by `Recording.metrics`.
        path: the file, metrics.json; an existing one is replaced.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    temporary.replace(path)
