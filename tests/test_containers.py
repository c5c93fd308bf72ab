"""The images are described as they should be; building them needs an image registry, so no test does."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
DOCKERFILES = sorted((ROOT / "docker").glob("Dockerfile.*"))
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
VARIABLE = "${PIDTSM_IMAGE:-wheels}"


def instructions(dockerfile: Path) -> list[tuple[str, str]]:
    text = re.sub(r"\\\n\s*", "", dockerfile.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(name, arguments) for name, arguments in (line.split(" ", 1) for line in lines)]


def stages(dockerfile: Path) -> dict[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = {}
    for instruction, arguments in instructions(dockerfile):
        if instruction == "FROM":
            current = found.setdefault(arguments.partition(" AS ")[2], [])
        current.append((instruction, arguments))
    return found


@pytest.mark.parametrize("dockerfile", DOCKERFILES, ids=lambda d: d.name)
def test_hadolint_finds_nothing(dockerfile: Path) -> None:
    hadolint = shutil.which("hadolint")
    assert hadolint
    done = subprocess.run([hadolint, "--no-color", str(dockerfile)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("dockerfile", DOCKERFILES, ids=lambda d: d.name)
def test_images_are_pinned_and_run_without_privileges(dockerfile: Path) -> None:
    found = stages(dockerfile)
    assert [stage for stage in found if stage != "stripped"] == ["build", "test", "runtime"]
    bases = {found[stage][0][1].partition(" AS ")[0] for stage in found} - {"build"}
    assert all(re.fullmatch(r"\w+:\w+(-\w+)+", base) for base in bases), "a release, not what is latest"
    assert not any(instruction == "ADD" for instruction, _ in instructions(dockerfile))
    for stage in ("test", "runtime"):
        users = [arguments for instruction, arguments in found[stage] if instruction == "USER"]
        assert users == ["10001"]
    runtime = " ".join(arguments for _, arguments in found["runtime"])
    assert "build-essential" not in runtime, "compilers stay behind"


def test_up_starts_the_system_alone() -> None:
    assert {name for name, service in SERVICES.items() if service.get("profiles", ["system"]) == ["system"]} == {
        "simulator",
        "trajectory",
        "controller",
        "recorder",
    }


def test_services_have_no_network_and_no_privileges() -> None:
    for name, service in SERVICES.items():
        assert service["network_mode"] in ("none", "service:simulator"), name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
    assert SERVICES["simulator"]["network_mode"] == "none"


@pytest.mark.parametrize("service", sorted(SERVICES))
def test_services_are_built_from_what_is_there(service: str) -> None:
    build = SERVICES[service]["build"]
    for image in ("wheels", "jazzy"):
        dockerfile = ROOT / build["dockerfile"].replace(VARIABLE, image)
        assert build["target"] in stages(dockerfile)
    assert (ROOT / "docker" / build["context"] / "pidtsm").is_file()


def test_the_system_runs_executables_that_exist() -> None:
    named = re.findall(r"/opt/pidtsm/(ros2_ws/install/(\S+?)/lib/\S+?/\w+)", yaml.safe_dump(COMPOSE, width=1000))
    assert {package for _, package in named} == {"two_link_sim", "pidtsm_controller", "pidtsm_experiments"}
    assert len(named) == 4
    for path, _ in named:
        assert (ROOT / path).is_file(), path
