"""Every result records where it comes from, and there is one version."""

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pidtsm_core
from pidtsm_core.recording.provenance import commit
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.results import result_folder
from pidtsm_studies.reports import figures

SOURCES = Path(__file__).resolve().parents[3]


def test_a_result_names_version_commit_command_seed_and_all_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["pidtsm", "rollout"])
    out = tmp_path / "one"
    assert main(["rollout", "--duration", "0.1", "--set", "simulator.seed=7", "--out", str(out)]) in (0, 1)
    content = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert content["version"] == pidtsm_core.__version__
    assert content["command"] == ["pidtsm", "rollout"]
    assert content["seed"] == 7
    assert set(content["parameters"]) == {"simulator", "controller", "trajectory"}
    assert content["parameters"]["simulator"]["seed"] == 7
    assert len(content["parameters"]["controller"]) > 20
    if (SOURCES.parents[1] / ".git").exists():
        assert re.fullmatch(r"[0-9a-f]{40}(\+changes)?", content["commit"])


def test_a_result_without_a_run_has_its_origin_too(tmp_path: Path) -> None:
    with result_folder(tmp_path / "out") as folder:
        (folder / "score.json").write_text("{}", encoding="utf-8")
    content = json.loads((tmp_path / "out/run.json").read_text(encoding="utf-8"))
    assert content["version"] == pidtsm_core.__version__
    assert content["parameters"] is content["seed"] is None


def test_the_repository_of_somebody_else_is_not_the_source(tmp_path: Path) -> None:
    (tmp_path / "__init__.py").touch()
    assert commit(tmp_path) is None
    subprocess.run(["git", "init", "--quiet", str(tmp_path)], check=True)
    assert commit(tmp_path) is None


def test_the_command_line_prints_the_version(capsys: pytest.CaptureFixture[str]) -> None:
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


def made(*words: str) -> None:
    """Call a command under its own name, as from a shell."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["/somewhere/pidtsm", *words])
        assert main(words) == 0


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Results of commands that read each other's."""
    parent = tmp_path_factory.mktemp("results")
    short = ("--duration", "0.2", "--set", "simulator.seed=7")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "FIGURES", {"error": figures.error})
        patch.chdir(parent)
        made("rollout", *short, "--out", "one", "--bag")
        made("rollout", *short, "--out", "two")
        made("compare", "one", "two", "--out", "compare")
        made("report", "one/bag", "--out", "report")
        made("report", "two")
        yield parent


def content_of(folder: Path) -> dict[str, Any]:
    content = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert content["version"] == pidtsm_core.__version__
    assert content["commit"] == commit()
    return dict(content)


@pytest.mark.parametrize(
    ("folder", "command", "seed", "nodes"),
    [("one", "rollout", 7, 3), ("two", "rollout", 7, 3), ("compare", "compare", None, 0), ("report", "report", 7, 3)],
)
def test_a_result_records_what_made_it(results: Path, folder: str, command: str, seed: int | None, nodes: int) -> None:
    content = content_of(results / folder)
    assert content["command"][:2] == ["/somewhere/pidtsm", command]
    assert content["seed"] == seed
    assert len(content["parameters"] or ()) == nodes


def test_what_was_made_of_runs_has_their_origins(results: Path) -> None:
    one, two = (content_of(results / name) for name in ("one", "two"))
    two.pop("renewed")
    assert content_of(results / "compare")["runs"] == {"one": one, "two": two}
    assert content_of(results / "report")["runs"] == {"one/bag": one}


def test_a_folder_of_which_parts_are_made_anew_stays_what_it_is(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(results)
    monkeypatch.setattr(figures, "FIGURES", {"error": figures.error})
    content = content_of(results / "two")
    assert content["command"][1] == "rollout"
    assert [each["command"][1:] for each in content["renewed"]] == [["report", "two"]]
    made("report", "two")
    assert content_of(results / "two") == content, "the same command adds nothing"
    (results / "two/run.json").write_text("[")  # As of another program, or damaged.
    made("report", "two")
    assert content_of(results / "two")["parameters"] == content["parameters"]
