"""The answers at the top of a report."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording.outcome import FOLLOWED, ROUGH, STOPPED
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.written import quantity
from pidtsm_studies.reports.events import SYMBOLS, Event, events
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN
from pidtsm_studies.reports.verdicts import run_answers, run_verdict, state_of


@pytest.fixture
def metrics(run_of: Any) -> dict[str, Any]:
    """Metrics of a run with two joints."""
    return {**run_of("case1", "piddtsm")[1]}


def answers(metrics: dict[str, Any], *events: Event) -> dict[str, tuple[str, str, str]]:
    """Answer, detail and state by question."""
    return {each.question: (each.text, each.detail, each.state) for each in run_answers(metrics, events)}


@pytest.mark.parametrize(
    ("error", "state", "text", "sentence"),
    [(ROUGH, GOOD, "Yes", "Followed; "), (1.01 * ROUGH, PLAIN, "Roughly", "Followed roughly; ")],
)
def test_a_run_that_ends_far_from_its_reference_has_followed_roughly(
    metrics: dict[str, Any], error: float, state: str, text: str, sentence: str
) -> None:
    metrics |= {"outcome": FOLLOWED, "steady_state_error": [0.0, error], "saturation": [0.0, 0.0]}
    assert state_of(metrics) == state
    assert answers(metrics)["Did it follow?"][0] == text
    assert run_verdict(metrics).startswith(sentence)


def test_of_a_stopped_run_the_joint_that_caused_the_stop_is_the_worst(metrics: dict[str, Any]) -> None:
    fault = {"fault": "tracking_limit", "time": 1.0, "joint": "joint2", "reset": None, "limited": []}
    metrics |= {"outcome": STOPPED, "faults": [fault], "rmse": [1.0, 0.1]}
    found = answers(metrics)
    assert found["Which joint is worst?"] == ("joint2", "it caused the stop", BAD)
    assert found["How well?"][1:] == ("including the time after the stop", BAD)


def test_what_matters_more_is_named_before_what_came_earlier(metrics: dict[str, Any]) -> None:
    metrics["outcome"] = FOLLOWED
    happened = [Event(kind, float(time), None, f"a {kind}", f"a {kind}") for time, kind in enumerate(sorted(SYMBOLS))]
    text, detail, state = answers(metrics, *happened)["What happened?"]
    assert text.startswith("A fault at")
    assert "a push at" in text
    assert (detail, state) == ("4 more, see the marks", BAD)
    others = [event for event in happened if event.kind != "fault"]
    assert answers(metrics, *others)["What happened?"][0].startswith("A payload at")


@pytest.mark.parametrize(("scene", "label"), [("wall.xml", "contact"), ("", "external effort limit")])
def test_a_simulated_arm_touches_something_only_where_something_is(run_of: Any, scene: str, label: str) -> None:
    recording, metrics = run_of("case1", "piddtsm")
    violation = {"limit": "external_effort", "time": 0.5, "duration": 0.1}
    found = events(recording, {**metrics, "faults": [], "violations": [violation]}, {"scene": scene})
    assert [event.label for event in found if event.kind in ("contact", "limit")] == [label]


def test_what_came_of_a_push_is_told(metrics: dict[str, Any]) -> None:
    push = {"push.effort": [20.0, 0.0], "push.time": 3.0, "push.duration": 0.2}
    run = rollout("case1", params="practical", duration=5.0, simulator=push)
    metrics |= {**run.metrics(), "outcome": FOLLOWED}
    far, left = np.abs(run.error[3000:4201, 0]).max(), abs(run.error[4200, 0])
    distances = [quantity(float(each), "rad") for each in (far, left)]
    told = f"joint1 is up to {distances[0]} away, and {distances[1]} after {quantity(1.0, 's')}"
    assert answers(metrics, *events(run, metrics, push))["What happened?"][1] == told
