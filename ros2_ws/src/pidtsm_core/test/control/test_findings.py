"""What a rollout has found is in its metrics and in words, and survives the way over /diagnostics."""

import json

import pytest

from pidtsm_core.control.findings import Finding, What, as_json, from_json, from_readings, readings, statements
from pidtsm_core.recording.outcome import what_happened
from pidtsm_core.rollouts.closed_loop import rollout

EVERYTHING = (
    Finding(What.FRICTION, "joint 1 (left)", 6.125, 0.25, "N m"),
    Finding(What.FRICTION, "slide", -2.0, 0.5, "N"),
    Finding(What.LATENESS, "", 0.03125, 0.0625, "s"),
    Finding(What.DELAY, "", 0.03125, None, "s"),
    Finding(What.LAG, "", 0.0, None, "s"),
    Finding(What.ROUGHNESS, "wrist", 0.0078125, None, ""),
    Finding(What.PACE, "", 0.5, None, ""),
)


def test_findings_survive_json_and_diagnostics() -> None:
    text = json.dumps([as_json(each) for each in EVERYTHING])
    assert tuple(map(from_json, json.loads(text))) == EVERYTHING
    pairs = [(name + (f" ({unit})" if unit else ""), f"{value:.6g}") for name, value, unit in readings(EVERYTHING)]
    others = [("rate (1/s)", "1000"), ("found nothing of it", "1"), ("found friction of x", "many"), ("found", "")]
    assert from_readings([*others, *pairs]) == EVERYTHING


def test_a_rollout_tells_what_it_found() -> None:
    adaptive = {"robot": "panda", "duration": 10.0, "params": "adaptive"}
    stiff = rollout(**adaptive, simulator={"friction.coulomb": 9.0, "encoder.bits": 14})  # type: ignore[arg-type]
    found = {(each.what, each.joint): each for each in stiff.found or ()}
    assert found[What.FRICTION, "panda_joint2"].value == pytest.approx(9.0, rel=0.15)
    metrics = stiff.metrics()
    assert [from_json(each) for each in metrics["found"]] == list(found.values())
    assert {each.text for each in statements(found.values())} <= set(what_happened(metrics))
    late = rollout(**adaptive, simulator={"delay.samples": 40})  # type: ignore[arg-type]
    assert next(each.value for each in late.found or () if each.what is What.LATENESS) == pytest.approx(0.04, rel=0.25)
    assert rollout(**adaptive).metrics()["found"] is None  # type: ignore[arg-type]
    assert rollout(duration=0.1).metrics()["found"] is None
