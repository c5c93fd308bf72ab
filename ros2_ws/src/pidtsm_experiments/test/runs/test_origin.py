"""Every result says where it comes from, and there is one version."""

import json
import re
import subprocess
from pathlib import Path

import pytest

import pidtsm_core
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs import origin
from pidtsm_experiments.runs.results import result_folder

SOURCES = Path(__file__).resolve().parents[3]


def test_a_result_names_version_commit_command_seed_and_all_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["pidtsm", "rollout"])
    out = tmp_path / "one"
    assert main(["rollout", "--duration", "0.1", "--set", "simulator.seed=7", "--out", str(out)]) in (0, 1)
    said = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert said["version"] == pidtsm_core.__version__
    assert said["command"] == ["pidtsm", "rollout"]
    assert said["seed"] == 7
    assert set(said["parameters"]) == {"simulator", "controller", "trajectory"}
    assert said["parameters"]["simulator"]["seed"] == 7
    assert len(said["parameters"]["controller"]) > 20
    if (SOURCES.parents[1] / ".git").exists():
        assert re.fullmatch(r"[0-9a-f]{40}(\+changes)?", said["commit"])


def test_a_result_without_a_run_has_its_origin_too(tmp_path: Path) -> None:
    with result_folder(tmp_path / "out") as folder:
        (folder / "score.json").write_text("{}", encoding="utf-8")
    said = json.loads((tmp_path / "out/run.json").read_text(encoding="utf-8"))
    assert said["version"] == pidtsm_core.__version__
    assert said["parameters"] is said["seed"] is None


def test_the_repository_of_somebody_else_is_not_the_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "version.py").touch()
    monkeypatch.setattr(origin, "_SOURCE", tmp_path)
    assert origin.commit() is None
    subprocess.run(["git", "init", "--quiet", str(tmp_path)], check=True)
    assert origin.commit() is None


def test_the_command_line_tells_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"pidtsm {pidtsm_core.__version__}\n"


def test_every_package_has_the_one_version() -> None:
    files = [*SOURCES.glob("*/package.xml"), *SOURCES.glob("*/setup.py")]
    assert len(files) > 10
    for file in files:
        found = re.search(r"<version>(.*?)</version>|    version=\"(.*?)\"", file.read_text(encoding="utf-8"))
        assert found, file
        assert pidtsm_core.__version__ in found.groups(), file
