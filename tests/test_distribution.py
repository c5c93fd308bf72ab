"""What leaves the checkout: the offline bundle installs without network; names and versions agree everywhere."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from pidtsm_core import __version__

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from distribution.tools import SUPPORTED, outside, pythons  # noqa: E402
from distribution.version import find_differences  # noqa: E402

ALONE = ("unshare", "--map-root-user", "--net")
"""Runs a command in a network namespace of its own, where nothing is to be reached."""


def isolates() -> bool:
    return shutil.which("unshare") is not None and subprocess.run([*ALONE, "true"], capture_output=True).returncode == 0


@pytest.mark.skipif(not isolates(), reason="this machine allows no network namespace")
def test_a_bundle_installs_without_network_and_no_damaged_one(tmp_path: Path) -> None:
    version = list(pythons())[-1]
    bundle, target = tmp_path / "bundle", tmp_path / "environment"
    words = [sys.executable, str(ROOT / "scripts" / "bundle.py"), "--python", version, "--out", str(bundle)]
    subprocess.run(words, check=True, env={**outside(), "PYTHONDONTWRITEBYTECODE": "1"})
    environment = {**outside(), "PIDTSM_PYTHON": str(pythons()[version]), "PIP_NO_COMPILE": "1"}

    def install() -> "subprocess.CompletedProcess[str]":
        words = [*ALONE, "sh", str(bundle / "install.sh"), str(target)]
        return subprocess.run(words, env=environment, capture_output=True, text=True)

    done = install()
    assert done.returncode == 0, done.stdout + done.stderr
    shown = subprocess.check_output([target / "bin" / "pidtsm", "--version"], text=True, env=environment)
    assert shown == f"pidtsm {__version__}\n"

    shutil.rmtree(target)
    with next((bundle / "wheels").glob("rich-*.whl")).open("ab") as file:
        file.write(b"\0")
    done = install()
    assert done.returncode != 0
    assert "FAILED" in done.stdout + done.stderr
    assert not target.exists()


def test_a_version_that_differs_is_named(tmp_path: Path) -> None:
    assert find_differences(ROOT) == []
    for name in ("CITATION.cff", "ros2_ws/src/pidtsm_core/pidtsm_core/__init__.py", "ros2_ws/src/pidtsm_ros/setup.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    citation = tmp_path / "CITATION.cff"
    citation.write_text(citation.read_text("utf-8").replace(f"\nversion: {__version__}", "\nversion: 0.0.9"), "utf-8")
    assert find_differences(tmp_path) == ["CITATION.cff"]


def test_the_same_versions_of_python_are_supported_everywhere() -> None:
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    assert re.findall(r'"Programming Language :: Python :: (3\.\d+)"', project) == list(SUPPORTED)
    assert f'requires-python = ">={SUPPORTED[0]}"' in project
    oldest, newest = (version.replace(".", ", ") for version in (SUPPORTED[0], SUPPORTED[-1]))
    assert f"({oldest}) <= sys.version_info[:2] <= ({newest})" in (ROOT / "pidtsm").read_text("utf-8")
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "checks.yml").read_text("utf-8"))["jobs"]
    assert jobs["tests"]["strategy"]["matrix"]["python"] == list(SUPPORTED)
    assert sorted(jobs["wheels"]["steps"][1]["with"]["python-version"].split()) == sorted(SUPPORTED)


def test_checks_on_github_call_commands_that_exist() -> None:
    text = (ROOT / ".github" / "workflows" / "checks.yml").read_text("utf-8")
    called = set(re.findall(r"\./pidtsm (\w+)", text))
    assert called >= {"shell", "test", "release", "docs"}
    known = subprocess.check_output([sys.executable, "-m", "pidtsm_experiments.cli", "--help"], text=True)
    assert all(re.search(rf"^ +{command} ", known, re.MULTILINE) for command in called)
