"""Two result folders of rollouts, with one figure instead of five, as drawing takes long."""

from pathlib import Path

import pytest

from pidtsm_experiments.cli import main
from pidtsm_studies.reports import figures

WORDS = ["--duration", "0.5"]
GAIN = 4.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the test, in which commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the results ``gentle`` and ``firm``; do not change it."""
    parent = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "FIGURES", {"error": figures.error})
        for name, words in (("gentle", []), ("firm", ["--set", f"controller.law.k1={GAIN}"])):
            assert main(["rollout", *WORDS, *words, "--out", str(parent / name)]) == 0
    return parent
