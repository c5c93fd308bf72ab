"""``./pidtsm replay`` of results as they come: of rollouts, bags, other versions, and what cannot be made again."""

import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_experiments.cli import main
from pidtsm_studies.reports import figures


def replay(capsys: pytest.CaptureFixture[str], *words: Path | str) -> tuple[int, dict[str, Any]]:
    code = main(["replay", *map(str, words), "--json"])
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert content["agree"] is (code == 0)
    return code, content


def edited(folder: Path, source: Path, **values: Any) -> Path:
    """A copy of a result, in whose run.json keys, or NODE__PARAMETER with __ for dots, are replaced."""
    shutil.copytree(source, folder)
    content = json.loads((folder / "run.json").read_text())
    for key, value in values.items():
        node, _, name = key.partition("__")
        if name:
            content["parameters"][node][name.replace("__", ".")] = value
        elif value is None:
            content.pop(key)
        else:
            content[key] = value
    (folder / "run.json").write_text(json.dumps(content))
    return folder


def test_a_result_of_a_rollout_is_there_again(kept: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (kept / "firm", kept / "firm" / "run.json"):
        code, content = replay(capsys, path)
        assert code == 0
        assert (content["samples"], content["lacking"], content["differences"]) == (500, 0, [])
    assert main(["replay", str(kept / "firm")]) == 0
    assert "the bits agree: 24 quantities, 500 samples" in capsys.readouterr().out
    assert list(folder.iterdir()) == [], "it leaves nothing"


def test_a_bag_is_compared_with_its_own_data(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FIGURES", {})
    words = ["--robot", "scara", "--params", "practical", "--set", "simulator.noise.std=1e-4", "--duration", "0.2"]
    assert main(["rollout", *words, "--out", "mine", "--bag"]) == 0
    capsys.readouterr()
    for path in ("mine", "mine/bag"):
        code, content = replay(capsys, path)
        assert (code, content["samples"]) == (0, 200), content


def test_changed_data_are_found_where_they_are(kept: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(kept / "firm", "other")
    with np.load("other/recording.npz") as content:
        arrays = dict(content)
    arrays["effort"][123, 1] += 1e-9
    np.savez("other/recording.npz", **arrays)
    assert main(["replay", "other"]) == 1
    text = capsys.readouterr().out
    assert "the bits differ, first at sample 123 (0.123 s): effort of joint2 was " in text
    assert "by at most 1e-09 in the whole run" in text
    assert "likely reason: " in text


def test_parameters_decide_not_the_command(kept: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(capsys, edited(folder / "words", kept / "firm", command=["pidtsm", "rm"]))[0] == 0
    code, content = replay(capsys, edited(folder / "gains", kept / "firm", controller__law__k1=4.5))
    assert code == 1
    assert content["differences"][0]["sample"] == 0
    assert "run.json has other values than what was recorded: controller.law.k1" in content["different_here"]


def test_old_results_without_an_environment_replay(
    kept: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = edited(folder / "old", kept / "firm", environment=None, version="0.1.0", commit="")
    with np.load(old / "recording.npz") as content:
        arrays = dict(content)
    text = json.loads(str(arrays["text"]))
    for name in ("parameters", "version", "recorded_commit"):
        text.pop(name)
    np.savez(old / "recording.npz", **{**arrays, "text": np.array(json.dumps(text))})
    code, content = replay(capsys, old)
    assert code == 0
    assert "it was made by pidtsm 0.1.0; this is" in content["different_here"][0]
    assert any("does not say with which libraries" in text for text in content["different_here"])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"controller__law__name": "mine"}, "law.name: 'mine' must be one of"),
        ({"controller__law__k77": 1.0}, "unknown parameter law.k77"),
        ({"simulator__robot__description": "/nowhere/arm.urdf"}, "/nowhere/arm.urdf: No such file"),
    ],
)
def test_what_this_version_does_not_have_is_the_reason(
    kept: Path, folder: Path, values: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, content = replay(capsys, edited(folder / "other", kept / "firm", **values))
    assert (code, content["samples"]) == (1, 0)
    assert said in content["different_here"][0]
    assert main(["replay", "other"]) == 1
    assert "cannot be made again: " in capsys.readouterr().out


@pytest.mark.parametrize("chosen", ["controller.law.name", "trajectory.reference.name", "simulator.disturbance.name"])
def test_a_member_that_is_not_installed_is_called_so(
    kept: Path, folder: Path, chosen: str, capsys: pytest.CaptureFixture[str]
) -> None:
    node, _, name = chosen.partition(".")
    _, content = replay(capsys, edited(folder / "other", kept / "firm", **{f"{node}__{name}": "theirs"}))
    assert content["different_here"][0].endswith("(a member from outside, or a file, that is not on this machine?)")


def test_a_run_in_real_time_cannot_agree(
    kept: Path, folder: Path, run: Recording, write_bag: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    edited(folder / "real", kept / "firm")
    (folder / "real" / "recording.npz").unlink()
    write_bag(folder / "real" / "bag", run, metadata={"clock": "realtime", "scenario": "case1", "law": "piddtsm"})
    assert replay(capsys, "real")[0] == 1
    assert main(["replay", "real"]) == 1
    assert "cannot be made again: a run in real time" in capsys.readouterr().out


def test_it_keeps_what_it_makes_and_the_reader_sees_who_made_it(
    kept: Path, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FIGURES", {})
    assert replay(capsys, kept / "firm", "--out", "again")[0] == 0
    arrays = [np.load(place / "recording.npz")["effort"] for place in (kept / "firm", folder / "again")]
    assert arrays[0].tobytes() == arrays[1].tobytes()
    assert zipfile.is_zipfile("again/recording.npz")
    page = Path("again/report.html").read_text(encoding="utf-8")
    assert "How it was made" in page
    assert '<th scope="row">law.k1</th><td>4.0</td>' in page


def test_what_is_no_run_is_bad_usage(kept: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", "nowhere"]) == 2
    assert main(["replay", str(edited(folder / "of_others", kept / "firm", runs={"a": None, "b": None}))]) == 2
    assert main(["replay", str(edited(folder / "bare", kept / "firm", parameters={"controller": {}}))]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 3
    assert "replay them: a, b" in error
