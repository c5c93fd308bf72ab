"""What leaves the checkout: the offline bundle installs without network; names and versions agree everywhere."""

import http.server
import json
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
import yaml

from pidtsm_core import __version__

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from distribution.audit import audit  # noqa: E402
from distribution.ros_packages import build_packages  # noqa: E402
from distribution.tools import SUPPORTED, DistributionError, call, emptied, outside, pythons, tools  # noqa: E402
from distribution.version import find_differences  # noqa: E402
from release import FILES, run  # noqa: E402

ALONE = ("unshare", "--map-root-user", "--net")
"""Runs a command in a network namespace of its own, where nothing is to be reached."""


def isolates() -> bool:
    return shutil.which("unshare") is not None and subprocess.run([*ALONE, "true"], capture_output=True).returncode == 0


@pytest.mark.long
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


class Advisories(http.server.BaseHTTPRequestHandler):
    """A database that answers as osv.dev does, and knows one vulnerability."""

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        known = [{"id": "PYSEC-2026-1", "summary": "", "details": "", "aliases": [], "affected": []}]
        answer = json.dumps({"vulns": known} if asked["package"]["name"] == "leaky" else {}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def advisories() -> Iterator[tuple[str, ...]]:
    """Options of pip-audit."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Advisories) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield "--vulnerability-service=osv", f"--osv-url=http://127.0.0.1:{server.server_port}"
        server.shutdown()


def lock_of(folder: Path, package: str) -> Path:
    lock = folder / "some.lock"
    lock.write_text(f"{package}==1.0 --hash=sha256:{'0' * 64}\n", "utf-8")
    return lock


def test_an_audit_names_a_vulnerable_package(tmp_path: Path, advisories: tuple[str, ...]) -> None:
    programs = tools("release")
    assert audit(lock_of(tmp_path, "tight"), programs, *advisories) == "some.lock: no known vulnerability in 1 packages"
    with pytest.raises(DistributionError, match=r"some\.lock has known vulnerabilities: leaky 1\.0: PYSEC-2026-1"):
        audit(lock_of(tmp_path, "leaky"), programs, *advisories)


def test_an_audit_without_a_database_is_none(tmp_path: Path) -> None:
    nowhere = ("--vulnerability-service=osv", "--osv-url=http://127.0.0.1:9")
    assert "not audited" in audit(lock_of(tmp_path, "leaky"), tools("release"), *nowhere)


def test_an_audit_names_the_packages_that_the_database_does_not_have(tmp_path: Path) -> None:
    program = tmp_path / "pip-audit"

    def audited(*found: Mapping[str, object]) -> str:
        program.write_text(f"#!/bin/sh\necho '{json.dumps({'dependencies': found})}'\n", "utf-8")
        program.chmod(0o755)
        return audit(tmp_path / "some.lock", tmp_path)

    known = {"name": "known", "version": "1.0", "vulns": []}
    strange = {"name": "strange", "skip_reason": "not found"}
    shown = audited(known, strange)
    assert shown == "some.lock: no known vulnerability in 1 packages; not in the database, so not audited: strange"
    assert audited(strange) == "some.lock: not audited (none of its 1 packages is in the database)"


def test_a_release_goes_on_after_a_step_that_fails(capsys: pytest.CaptureFixture[str]) -> None:
    def fails() -> str:
        return call("pidtsm-no-such-program", environment=outside())

    assert run({"first": fails, "second": lambda: "second: well"}) == ["first"]
    shown = capsys.readouterr().err
    assert "pidtsm: first failed: this needs the program pidtsm-no-such-program, which is not here\n" in shown
    assert shown.endswith("pidtsm: second: well\n")


def test_ros_packages_that_cannot_be_built_are_no_release(tmp_path: Path) -> None:
    file = tmp_path / "small-1.0.tar.gz"

    def packed(setup: str) -> Path:
        package = tmp_path / "small-1.0" / "ros2_ws" / "src" / "small"
        (package / "small").mkdir(parents=True, exist_ok=True)
        (package / "small" / "__init__.py").touch()
        (package / "resource").mkdir(exist_ok=True)
        (package / "resource" / "small").touch()
        (package / "setup.py").write_text(setup, "utf-8")
        (package / "package.xml").write_text(
            '<package format="3"><name>small</name><version>1.0.0</version><description>-</description>'
            '<maintainer email="a@b.example">a</maintainer><license>none</license>'
            "<export><build_type>ament_python</build_type></export></package>",
            "utf-8",
        )
        subprocess.run(["tar", "-czf", file, "-C", tmp_path, "small-1.0"], check=True)
        return file

    setup = "from setuptools import setup\nsetup(name='small', version='1.0.0', packages=['small'])\n"
    assert build_packages(packed(setup)) == 1
    with pytest.raises(DistributionError, match="ModuleNotFoundError: No module named 'small'"):
        build_packages(packed(setup.replace("['small']", "[]")))
    with pytest.raises(DistributionError, match=r"colcon build .*: exit code 1\n"):
        build_packages(packed("setup("))
    with pytest.raises(DistributionError, match=r"none-1\.0\.tar\.gz: exit code 2\n"):
        build_packages(tmp_path / "none-1.0.tar.gz")


@pytest.mark.parametrize("command", ["release", "bundle", "docs"])
def test_a_folder_with_files_of_others_is_not_emptied(command: str, tmp_path: Path) -> None:
    (tmp_path / "SHA256SUMS").touch()
    (tmp_path / "thesis.tex").touch()
    words = [sys.executable, str(ROOT / "scripts" / f"{command}.py"), "--out", str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 1
    assert "not of an earlier call: name an empty folder" in done.stderr
    assert done.stderr.count("\n") == 1
    assert {file.name for file in tmp_path.iterdir()} == {"SHA256SUMS", "thesis.tex"}


def test_what_an_earlier_call_left_is_removed(tmp_path: Path) -> None:
    out = tmp_path / "new" / "dist"
    assert list(emptied(out, FILES).iterdir()) == []
    for name in ("SHA256SUMS", "pidtsm-0.1.0.tar.gz", "pidtsm-0.1.0-py3-none-any.whl", "pidtsm-0.1.0.cdx.json"):
        (out / name).touch()
    assert list(emptied(out, FILES).iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(DistributionError, match="file cannot be written: File exists"):
        emptied(tmp_path / "file", FILES)


def test_checks_on_github_call_commands_that_exist() -> None:
    text = (ROOT / ".github" / "workflows" / "checks.yml").read_text("utf-8")
    called = set(re.findall(r"\./pidtsm (\w+)", text))
    assert called >= {"shell", "test", "release", "docs"}
    known = subprocess.check_output([sys.executable, "-m", "pidtsm_experiments.cli", "--help"], text=True)
    assert all(re.search(rf"^ +{command} ", known, re.MULTILINE) for command in called)


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda file: file.stem)
def test_checks_on_github_use_only_pinned_code_of_others(workflow: Path) -> None:
    """A tag can be moved to other code; a commit cannot. The comment is for readers and for Dependabot."""
    used = re.findall(r"^[- ]*uses: *(.+)$", workflow.read_text("utf-8"), re.MULTILINE)
    jobs = yaml.safe_load(workflow.read_text("utf-8"))["jobs"].values()
    parsed = [part["uses"] for job in jobs for part in (job, *job.get("steps", ())) if "uses" in part]
    assert parsed
    assert len(used) == len(parsed)
    foreign = [one for one in used if not one.startswith("./")]
    assert [one for one in foreign if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", one)] == []


def test_the_same_code_has_the_same_pin_everywhere() -> None:
    used = {one for file in WORKFLOWS for one in re.findall(r"uses: (\S+@.+)", file.read_text("utf-8"))}
    assert sorted({one.partition("@")[0] for one in used}) == sorted(one.partition("@")[0] for one in used)


def test_new_versions_of_what_is_pinned_are_proposed_each_week() -> None:
    updates = yaml.safe_load((ROOT / ".github" / "dependabot.yml").read_text("utf-8"))["updates"]
    assert {one["package-ecosystem"] for one in updates} == {"github-actions", "pip"}
    assert {(one["directory"], one["schedule"]["interval"]) for one in updates} == {("/", "weekly")}
