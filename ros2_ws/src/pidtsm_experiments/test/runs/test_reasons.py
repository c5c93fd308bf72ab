"""What differs between here and where a result was made is named, and nothing else."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pidtsm_core import __version__
from pidtsm_core.recording.provenance import environment
from pidtsm_experiments.runs import reasons as module
from pidtsm_experiments.runs.origin import digests
from pidtsm_experiments.runs.reasons import NOT_RECORDED, reasons

COMMIT = "a" * 40
DIGEST = "a1b569cebbcd0a00bbecee1faa81abcb1e6ad14c2ad87bf2ff8cc77c30566685"
"""What sha256sum prints for the text ``<robot/>``."""
HERE = {**environment(), "libc": "glibc 2.36", "features": ["avx2", "fma"]}
Change = Callable[[dict[str, Any]], object]


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "commit", lambda: COMMIT)
    monkeypatch.setattr(module, "environment", lambda: HERE)


def origin() -> dict[str, Any]:
    return {
        "version": __version__,
        "commit": COMMIT,
        "environment": copy.deepcopy(HERE),
        "parameters": {"simulator": {}},
    }


def test_the_same_machine_and_source_give_no_reason() -> None:
    assert reasons(origin()) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda it: it.update(version="0.0.1"), "it was made by pidtsm 0.0.1; this is"),
        (lambda it: it.update(commit="b" * 40), "it was made by commit bbbbbbbbbbbb; this is aaaaaaaaaaaa"),
        (lambda it: it.update(commit=COMMIT + "+changes"), "its source had changes that no commit has"),
        (lambda it: it.update(commit=None), "the commit of the result is not known"),
        (lambda it: it.pop("environment"), NOT_RECORDED),
        (lambda it: it["environment"].update(numba="0.1"), "it was made with numba 0.1; here is"),
        (lambda it: it["environment"].pop("llvmlite"), "it was made with llvmlite that is not known; here is"),
        (lambda it: it["environment"]["mathematics"].update(sin="0"), "other bits of sin (both glibc 2.36, which"),
        (
            lambda it: (it["environment"]["mathematics"].update(exp="0"), it["environment"].update(libc="glibc 2.31")),
            "other bits of exp (there glibc 2.31, here glibc 2.36)",
        ),
        (lambda it: it["environment"].update(features=["avx2"]), "its processor had no fma"),
        (lambda it: it["environment"].update(features=["avx2", "avx512f", "fma"]), "this processor has no avx512f"),
        (lambda it: it["environment"].update(target="i486"), "compiled for another processor (there i486, here"),
        (lambda it: it["environment"].update(python="3.10.1"), "another Python (there 3.10.1, here"),
    ],
)
def test_each_difference_is_one_reason(change: Change, said: str) -> None:
    other = origin()
    change(other)
    (only,) = reasons(other)
    assert said in only


def test_an_engine_counts_only_where_it_was_used() -> None:
    other = origin()
    other["environment"]["mujoco"] = "1.2.3"
    assert reasons(other) == []
    other["parameters"]["simulator"]["engine"] = "mujoco"
    assert "mujoco 1.2.3" in reasons(other)[0]


def test_what_the_controller_had_learnt_is_a_reason_and_no_file_of_the_arm(tmp_path: Path) -> None:
    learnt = tmp_path / "learnt.json"
    learnt.write_text("{}")
    parameters = {"controller": {"adaptation.file": str(learnt)}, "simulator": {}}
    assert digests(parameters) == {}
    (only,) = reasons(origin() | {"parameters": parameters})
    assert only == f"its controller continued from what {learnt} contained then (adaptation.file), if it existed"


def test_files_that_parameters_name_are_known_by_their_content(tmp_path: Path) -> None:
    arm = tmp_path / "arm.urdf"
    arm.write_text("<robot/>")
    files = digests({"controller": {"robot.description": str(arm), "law.name": "pid", "law.k1": 3.0}})
    assert files == {str(arm): DIGEST}
    assert reasons(origin() | {"files": files}) == []
    arm.write_text("<robot />")
    assert reasons(origin() | {"files": files}) == [f"{arm}: has changed since"]
    arm.unlink()
    assert reasons(origin() | {"files": files}) == [f"{arm}: is not on this machine; name it with --description"]
