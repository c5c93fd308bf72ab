"""A rollout leaves what a run leaves."""

import json
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.saved import load_recording
from pidtsm_studies.reports import figures

NODES = ("controller", "simulator", "trajectory")


def test_it_leaves_what_a_run_leaves(kept: Path) -> None:
    files = sorted(str(path.relative_to(kept / "firm")) for path in (kept / "firm").rglob("*") if path.is_file())
    assert files == [
        ".pidtsm.json",
        *(f"figures/error.{kind}" for kind in ("png", "svg")),
        "metrics.json",
        *(f"params/{node}.yaml" for node in NODES),
        "recording.npz",
        "report.html",
        "run.json",
    ]
    assert sorted(path.name for path in kept.iterdir()) == ["firm", "gentle"], "no litter"


def test_the_saved_recording_is_the_rollout_to_the_last_bit(kept: Path) -> None:
    result = rollout(controller={"law.k1": 4.0}, duration=0.5)
    saved = load_recording(kept / "firm" / "recording.npz")
    for name in ("time", "position", "velocity", "effort", "reference", "signals", "status"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(result, name), err_msg=name)
    assert (saved.joints, saved.scenario, saved.law, saved.clock) == (result.joints, "case1", "piddtsm", None)
    assert saved.metrics() == json.loads((kept / "firm" / "metrics.json").read_text())


def test_a_bag_of_a_rollout_is_read_like_that_of_a_run(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FIGURES", {})
    words = ["--robot", "scara", "--params", "practical", "--set", "simulator.dropout.time=0.1", "--duration", "0.3"]
    assert (
        main(["rollout", *words, "--set", "simulator.dropout.duration=0.02", "--out", "mine", "--bag", "--json"]) == 0
    )
    expected = json.loads(capsys.readouterr().out)
    assert main(["analyze", "mine/bag", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["lost"].values()) == {0}
    assert {**found, "lost": {}} == expected
    assert not (folder / "mine" / "recording.npz").exists()
    assert main(["report", "mine"]) == 0
    assert json.loads((folder / "mine" / "metrics.json").read_text()) == found


def test_a_bag_needs_a_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rollout", "--bag"]) == 2
    assert "--bag needs --out" in capsys.readouterr().err


def test_the_parameters_that_it_leaves_give_the_same_rollout(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [word for node in NODES for word in ("--params", str(kept / "firm" / "params" / f"{node}.yaml"))]
    assert main(["rollout", "--duration", "0.5", "--json", *files]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((kept / "firm" / "metrics.json").read_text())


def test_a_failed_rollout_keeps_earlier_results(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rollout", "--duration", "0.1", "--out", "out"]) == 0
    earlier = (folder / "out" / "metrics.json").read_text()
    # One second between samples, and almost no torque.
    weak = (f"{node}.limits.effort=1e-3" for node in ("simulator", "controller"))
    unstable = [word for each in (*weak, "simulator.rate=1") for word in ("--set", each)]
    assert main(["rollout", *unstable, "--duration", "1000", "--out", "out"]) == 1
    assert "not finite any more after" in capsys.readouterr().err
    assert (folder / "out" / "metrics.json").read_text() == earlier
    assert (folder / "out.failed" / "params" / "controller.yaml").is_file()
