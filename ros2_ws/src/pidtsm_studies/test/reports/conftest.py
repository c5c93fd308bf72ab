"""Runs with stand-ins for the article's laws, and the reports of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import pytest
import trimesh

from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.article.claims import Run, compare
from pidtsm_studies.reports.comparison import write_comparison
from pidtsm_studies.reports.labels import CASES
from pidtsm_studies.reports.report import write_report

RunOf: TypeAlias = Callable[[str, str], Run]

GAINS = {"piddtsm": 3.0, "pidnftsm": 2.0, "dtsm": 1.0}  # of stand-ins
NOTE = "DTSM with the printed kappa ends at 0.5 s <not a tag> & so on."
FAILED = "the loop is not finite any more after 0.5 s"


MESHED = """
<robot name="arm">
<link name="base"><visual><origin xyz="0 0 0.1"/><geometry>
<mesh filename="package://arm_description/{base}"/></geometry></visual></link>
<link name="upper"><inertial><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/><geometry>
<mesh filename="meshes/upper.obj" scale="0.001 0.001 0.001"/></geometry></visual>
<visual><origin xyz="0.5 0 0"/><geometry><box size="0.1 0.2 0.3"/></geometry></visual></link>
<link name="hand"><visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
<axis xyz="0 1 0"/><limit effort="9" velocity="2" lower="-1" upper="1"/></joint>
<joint name="end" type="fixed"><parent link="upper"/><child link="hand"/><origin xyz="0.6 0 0"/></joint>
</robot>
"""


@pytest.fixture(scope="session")
def run_of() -> RunOf:
    """Two seconds of a case with the stand-in for a law."""

    def run(case: str, law: str) -> Run:
        stand_in = rollout(controller={"law.k1": GAINS[law]}, duration=2.0)
        recording = replace(stand_in, scenario=case, law=law, event_time=1.0 if case == "case2" else None)
        return recording, recording.metrics()

    return run


@pytest.fixture(scope="session")
def reproduction(run_of: RunOf) -> dict[tuple[str, str], Run | str]:
    runs: dict[tuple[str, str], Run | str] = {(case, law): run_of(case, law) for case in CASES for law in GAINS}
    return {**runs, ("case1", "dtsm_printed"): FAILED}


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory, reproduction: dict[tuple[str, str], Run | str]) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, reproduction, compare(reproduction), [NOTE])
    return path


@pytest.fixture(scope="session")
def compared(run_of: RunOf) -> dict[str, Run]:
    """Runs with names."""
    return {name: run_of("case1", law) for name, law in (("gentle", "dtsm"), ("a/firm.1", "piddtsm"))}


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory, compared: dict[str, Run]) -> Path:
    path = tmp_path_factory.mktemp("comparison") / "report.html"
    write_comparison(path, compared, {"controller.law.k1": {"gentle": 1.0, "a/firm.1": 3.0}})
    return path


@pytest.fixture(scope="session")
def recordings(run_of: RunOf) -> dict[str, Recording]:
    """A short run of each of several arms, pushed so that the gain adapts."""
    found = {"two_link": run_of("case1", "piddtsm")[0]}
    for robot in ("panda", "scara"):
        push = {"push.effort": 5.0, "push.time": 0.3, "push.duration": 0.3}
        found[robot] = rollout(params=PRACTICAL, robot=robot, duration=1.0, simulator=push)
    return found


@pytest.fixture(scope="session")
def arms(tmp_path_factory: pytest.TempPathFactory, recordings: dict[str, Recording]) -> dict[str, Path]:
    """A report of each of `recordings` alone."""
    folder = tmp_path_factory.mktemp("arms")
    push = {"simulator": {"push.effort": 5.0, "push.time": 0.3, "push.duration": 0.3}}
    for robot, recording in recordings.items():
        write_report(folder / f"{robot}.html", (recording, recording.metrics()), parameters=push)
    return {robot: folder / f"{robot}.html" for robot in recordings}


@pytest.fixture(scope="session")
def described() -> Callable[..., Path]:
    """Writes a package with an arm of one joint that has meshes."""

    def write(folder: Path, base: str = "meshes/base.stl") -> Path:
        """An arm of a package: its meshes are an STL and an OBJ in millimetres; another is missing."""
        urdf = folder / "arm_description" / "urdf" / "arm.urdf"
        for place in (urdf.parent / "meshes", urdf.parents[1] / "meshes"):
            place.mkdir(parents=True, exist_ok=True)
        trimesh.creation.icosphere(5, 0.1).export(urdf.parents[1] / "meshes" / "base.stl")
        trimesh.creation.box((20.0, 40.0, 400.0)).export(urdf.parent / "meshes" / "upper.obj")
        urdf.write_text(MESHED.format(base=base), encoding="utf-8")
        return urdf

    return write
