"""A recording knows what made it, and what a result depends on is found without a doubt."""

import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import MISSING, fields
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from pidtsm_core import __version__
from pidtsm_core.experiment import make_experiment
from pidtsm_core.recording import Recording, provenance
from pidtsm_core.recording.provenance import LIBRARIES, environment
from pidtsm_core.rollouts.closed_loop import rollout

TUNABLES = "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA_Usable,-AVX2_Usable,-FMA4_Usable"
"""What makes glibc compute as on a processor without FMA, with the names of older and newer versions."""


@pytest.fixture(scope="module")
def run() -> Recording:
    return rollout("case2", duration=0.02, controller={"law.k1": [3.5, 4.5]}, simulator={"seed": 11})


def test_a_recording_has_the_parameters_that_made_it(run: Recording) -> None:
    given: dict[str, dict[str, Any]] = {"controller": {"law.k1": [3.5, 4.5]}, "simulator": {"seed": 11}}
    assert run.parameters == make_experiment("case2", None, 0.02, (), given).values
    assert run.gains["k1"] == run.parameters["controller"]["law.k1"] == (3.5, 4.5)
    assert (run.gains["name"], run.seed, run.version) == ("piddtsm", 11, __version__)


def test_the_commit_is_found_when_it_is_asked_for(run: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(subprocess, "run", lambda *words, **_: calls.append(words))
    provenance.commit_at_start.cache_clear()
    rollout(duration=0.01)
    assert not calls, "a rollout starts no process"
    monkeypatch.undo()
    provenance.commit_at_start.cache_clear()
    assert run.commit == provenance.commit()
    assert run.commit is None or re.fullmatch(r"[0-9a-f]{40}(\+changes)?", run.commit)


def test_it_survives_the_way_to_another_process(run: Recording) -> None:
    again = pickle.loads(pickle.dumps(run))
    assert (again.gains, again.seed, again.version, again.commit) == (run.gains, run.seed, run.version, run.commit)


def test_what_nobody_recorded_is_not_known(run: Recording) -> None:
    needed = {each.name: getattr(run, each.name) for each in fields(Recording) if each.default is MISSING}
    unknown = Recording(**{name: value for name, value in needed.items() if name not in ("parameters", "robot")})
    assert (unknown.gains, unknown.seed, unknown.version, unknown.commit) == ({}, None, None, None)


def test_libraries_and_processor_are_those_that_others_report() -> None:
    found = environment()
    assert found["python"] == sys.version.split()[0]
    installed = {each.metadata["Name"]: each.version for each in metadata.distributions()}
    assert {name: found[name] for name in LIBRARIES} == {name: installed.get(name) for name in LIBRARIES}
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    flags = next((line for line in lines if line.startswith("flags")), "").split()
    assert {"avx2", "fma"} & {*flags} <= {*found["features"]}


def test_mathematics_without_fused_operations_are_told_apart() -> None:
    """glibc itself is the other machine: told to avoid FMA, it computes with other code."""
    if "fma" not in environment()["features"] or not environment()["libc"].startswith("glibc"):
        pytest.skip("this processor or C library has no choice")
    code = "import json; from pidtsm_core.recording.provenance import environment as e; print(json.dumps(e()))"
    surroundings = {**os.environ, "GLIBC_TUNABLES": TUNABLES}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, env=surroundings, capture_output=True, text=True, check=True)
    other = json.loads(done.stdout)
    assert other["mathematics"]["sin"] != environment()["mathematics"]["sin"]
    assert other["libc"] == environment()["libc"]
