"""Metrics of a recorded bag."""

from pathlib import Path
from typing import Any

from pidtsm_experiments.bags.reader import METRICS_ONLY, read_recording


def analyze(bag: Path) -> dict[str, Any]:
    """Metrics of a bag, as in metrics.json.

    Raises:
        RecordingError: the bag does not contain a run.
    """
    return read_recording(bag, METRICS_ONLY).metrics()
