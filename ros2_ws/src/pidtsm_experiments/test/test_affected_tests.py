"""Which tests a change can break."""

import subprocess
from pathlib import Path

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_experiments.affected_tests import Sources, changed_files

ROOT = next(folder for folder in Path(__file__).resolve().parents if (folder / "pyproject.toml").is_file())
SOURCE = "ros2_ws/src"
FOUND_BY = {
    f"{SOURCE}/pidtsm_core/pidtsm_core/laws/surfaces/powers.py": "test/laws/surfaces/test_dual_terminal.py",
    f"{SOURCE}/pidtsm_core/pidtsm_core/units.py": "test/test_units.py",
    f"{SOURCE}/pidtsm_core/pidtsm_core/experiment/params/dtsm.yaml": "test/experiment/test_experiment.py",
    f"{SOURCE}/pidtsm_studies/pidtsm_studies/reports/figures.py": "test/reports/test_figures.py",
    f"{SOURCE}/pidtsm_studies/pidtsm_studies/reports/templates/viewer.js": "test/reports/test_report_in_browser.py",
    f"{SOURCE}/pidtsm_ros/pidtsm_ros/wire.py": "test/test_wire.py",
    f"{SOURCE}/pidtsm_controller/pidtsm_controller/goal_planning.py": "tests/test_goals.py",
    f"{SOURCE}/two_link_sim/two_link_sim/simulator_node.py": "tests/test_simulator_services.py",
    f"{SOURCE}/pidtsm_experiments/pidtsm_experiments/commands/gains.py": "test/commands/test_gains.py",
    "docs/faults.md": "tests/test_documentation.py",
    "scripts/launcher/environment.py": "tests/test_launcher.py",
}
"""A file, and a test that a mistake in it breaks."""


@pytest.fixture(scope="module")
def sources() -> Sources:
    return Sources(ROOT)


@pytest.mark.parametrize("changed", FOUND_BY)
def test_a_mistake_in_a_file_is_found(sources: Sources, changed: str) -> None:
    assert (ROOT / changed).is_file()
    found = sources.tests([changed])
    assert found is not None
    assert any(file.endswith(FOUND_BY[changed]) for file in found)


def test_what_a_change_cannot_break_is_not_run(sources: Sources) -> None:
    assert sources.tests([]) == []
    alone = f"{SOURCE}/pidtsm_core/test/test_units.py"
    assert sources.tests([alone]) == [alone]
    of_a_page = sources.tests(["docs/faults.md"])
    assert of_a_page is not None
    assert not any(file.endswith(("test_units.py", "test_figures.py")) for file in of_a_page)


def test_a_file_that_nothing_names_may_concern_everything(sources: Sources) -> None:
    assert sources.tests(["".join(("un", "heard", ".of"))]) is None


def test_changes_are_those_since_a_commit_and_new_files(tmp_path: Path) -> None:
    def git(*words: str) -> None:
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=tmp_path, check=True)

    git("init", "-q")
    for name in ("kept.py", "changed ä.py", "removed.py"):
        (tmp_path / name).write_text("")
    git("add", ".")
    git("commit", "-qm", "first")
    (tmp_path / "changed ä.py").write_text("1")
    (tmp_path / "removed.py").unlink()
    (tmp_path / "new.py").write_text("")
    assert changed_files(tmp_path, "HEAD") == ["changed ä.py", "new.py", "removed.py"]
    with pytest.raises(UsageError, match=r"--changed nowhere: .*nowhere"):
        changed_files(tmp_path, "nowhere")
