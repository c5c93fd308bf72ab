"""A stop is told with the value and the limit that it exceeded, as the controller found them."""

import re
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording.outcome import FOLLOWED
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_studies.reports.events import events
from pidtsm_studies.reports.stops import why
from pidtsm_studies.reports.verdicts import run_verdict

LIMITS: dict[str, tuple[dict[str, Any], str, float]] = {
    "velocity_limit": ({"limits.velocity": [0.4, 5.0]}, "moves at {value}/s, limit {limit}/s", 0.4),
    "tracking_limit": ({"limits.tracking_error": 0.3}, "is {value} from its reference, limit {limit}", 0.3),
    "position_limit": (
        {"limits.min_position": [-3.0, -3.0], "limits.max_position": [0.2, 3.0]},
        "is at {value}, limit {limit}",
        0.2,
    ),
}


@pytest.mark.parametrize("fault", LIMITS)
def test_the_headline_of_a_stop_has_value_and_limit(fault: str) -> None:
    settings, words, limit = LIMITS[fault]
    recording = rollout(duration=0.5, controller=settings)
    metrics = recording.metrics()
    (found,) = metrics["faults"]
    assert (found["fault"], found["joint"]) == (fault, "joint1")
    sample = int(np.searchsorted(recording.time, found["time"]))
    true = {
        "velocity_limit": abs(recording.signals[sample, Signal.VELOCITY, 0]),
        "tracking_limit": abs(recording.error[sample, 0]),
        "position_limit": recording.position[sample, 0],
    }[fault]
    happened = events(recording, metrics, {}, settings)
    verdict = run_verdict(metrics, happened)
    pattern = re.escape(words).replace(r"\{value\}", r"(\S+)\u202f(m?)rad").replace(r"\{limit\}", r"(\S+)\u202f(m?)rad")
    match = re.search(rf"^Stopped after .*: joint1 {pattern}", verdict)
    assert match, verdict
    value, bound = (float(match[i]) * (1e-3 if match[i + 1] else 1.0) for i in (1, 3))
    assert bound == limit < value
    assert value == pytest.approx(true, rel=1e-2)
    assert [event.label for event in happened if event.kind in ("fault", "limit")] == ["stop: joint1"]


def test_without_parameters_the_limit_is_named() -> None:
    recording = rollout(duration=0.1)
    fault = {"fault": "velocity_limit", "time": 0.05, "joint": "joint2", "reset": None}
    assert why(recording, fault, {}) == "joint2 is beyond limits.velocity"
    assert why(recording, {**fault, "fault": "of_another_version"}, {}) == "of_another_version"
    assert run_verdict({**recording.metrics(), "outcome": FOLLOWED}, []).startswith("Followed")
