"""The metrics of a run: the content of metrics.json."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.metrics import metrics
from pidtsm_core.outcome import happenings, time_at_limits
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_core.units import SLIDES


def summarize(recording: Recording) -> dict[str, Any]:
    """Metrics of a run, with the content and order of metrics.json; None for values that do not exist."""
    stamps = recording.stamps_ns
    periods = np.diff(stamps)
    # The last sample lasts for the median of the periods.
    span = int(stamps[-1] - stamps[0]) + (round(float(np.median(periods))) if periods.size else 0)
    saturated = recording.signals[:, Signal.SATURATED]
    computed = recording.compute_time
    p50, p99, longest = np.percentile(computed, (50, 99, 100)).tolist() if computed.size else (None, None, None)
    return {
        "scenario": recording.scenario,
        "law": recording.law,
        "clock": recording.clock,
        "duration": span / 1e9,
        "samples": len(stamps),
        "joints": list(recording.joints),
        "slides": [units == SLIDES for units in recording.units],
        **happenings(recording),
        **metrics(recording.time, recording.error, recording.effort, saturated, recording.event_time),
        **time_at_limits(recording),
        "adaptive_gain": recording.signals[-1, Signal.ADAPTIVE_GAIN].tolist(),
        "lost": dict(recording.lost),
        "rejected": None if recording.rejected is None else dict(recording.rejected),
        "timing": {
            "rate": 1e9 / float(np.mean(periods)) if periods.size else None,
            "period_max": int(periods.max()) / 1e9 if periods.size else None,
            "compute_time": {"p50": p50, "p99": p99, "max": longest},
        },
    }


def write_metrics(values: Mapping[str, Any], path: Path) -> None:
    """Write metrics as JSON, atomically: the file is never incomplete.

    Args:
        values: as returned by `summarize`.
        path: the file, metrics.json; an existing one is replaced.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    temporary.replace(path)
