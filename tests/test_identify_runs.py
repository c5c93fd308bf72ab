"""Identification from the bags of real nodes does what docs/identify.md states about rollouts."""

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from identification import arms, closed_loop, judge, motions, with_noise  # noqa: E402

from pidtsm_core.arrays import Array  # noqa: E402
from pidtsm_core.experiment import make_experiment  # noqa: E402
from pidtsm_core.identification.identification import identify  # noqa: E402
from pidtsm_core.robots import Description  # noqa: E402
from pidtsm_core.robots.description import read_description  # noqa: E402
from pidtsm_experiments.bags.measurements import read_measurement  # noqa: E402
from pidtsm_experiments.cli import main  # noqa: E402
from pidtsm_experiments.runs.runner import run  # noqa: E402

PAGE = ROOT / "docs" / "identify.md"
ROBOT, SEED = "panda", 0
RATE, DURATION = 500.0, 12.0
"""Hz and s: half the rate and a fifth of the time of the page's figures."""
CARRYING = 6.0  # s
MASS, CENTRE = 1.2, [0.02, -0.03, 0.04]
"""Of the payload, kg and m."""


def documented(row: str) -> list[float]:
    """The figures of the Panda in a row of the page."""
    (line,) = (line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {row}"))
    return [float(number) for number in re.findall(r"[\d.]+", line.rstrip("| ").rpartition("|")[2])]


def record(folder: Path, known: Description, duration: float, carried: Mapping[str, Any] | None = None) -> Path:
    """The bag of a run over real nodes in lockstep, with encoders of 14 bits."""
    folder.mkdir()
    times, motion = motions(ROBOT)
    first = times <= duration
    of_rollout = closed_loop(folder, (arms(ROBOT, SEED)[0], known), times[first], motion[:, first], SEED, carried)
    experiment = make_experiment(of_rollout, overrides={"simulator": {"rate": RATE}})
    return run(experiment, "lockstep", folder, lambda _time: None)


class Moved(NamedTuple):
    """An exciting motion: its bag, parameters pi of the arm, limits of its efforts (N m), its wrong description."""

    bag: Path
    truth: Array
    limit: Array
    known: Description


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Moved:
    true, truth, known = arms(ROBOT, SEED)
    bag = record(tmp_path_factory.mktemp("identify") / "moved", known, DURATION)
    return Moved(bag, truth, np.minimum(true.effort, 100.0), known)


def test_seven_joints_are_identified_as_well_as_the_page_says(moved: Moved) -> None:
    """Within a fifth of its figures; noise of the torque, which joint states do not have, is added as there."""
    measured, source = read_measurement(moved.bag)
    assert source == "joint_states, positions and efforts"
    assert measured.time.size == RATE * DURATION - 1  # Before the first sample, the drives have applied nothing.
    noisy = with_noise(measured, moved.limit, SEED)
    judged = judge(identify(moved.known, [noisy]), moved.truth, noisy)
    assert judged["warnings"] == []
    assert judged["consistent"]
    before, after = (np.array(judged[when]) for when in ("before", "after"))
    assert [100.0 * np.mean(judged["covered"])] == pytest.approx(documented("95 % intervals"), rel=0.2)
    assert [np.sqrt(np.mean(before**2))] == pytest.approx(documented("error of the torque on unseen motion"), rel=0.2)
    of_all, of_worst = documented("the same, identified")
    assert np.sqrt(np.mean(after**2)) == pytest.approx(of_all, rel=0.2)
    assert after.max() <= 1.2 * of_worst


def test_the_commands_find_arm_and_payload_in_such_bags(
    moved: Moved, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known, found = tmp_path / "known.urdf", tmp_path / "found"
    known.write_text(moved.known.text, encoding="utf-8")
    assert main(["identify", str(moved.bag), "--robot", str(known), "--out", str(found), "--json"]) == 0
    told_us = capsys.readouterr()
    assert "truth: joint_states, positions and efforts" in told_us.err
    errors = json.loads(told_us.out)["torque_error"]
    assert (np.array(errors["after"]) < 0.1 * np.array(errors["before"])).all()
    identified = found / "identified.urdf"
    carried = {"payload.mass": MASS, "payload.center_of_mass": CENTRE}
    carrying = record(tmp_path / "carrying", read_description(identified.read_text("utf-8")), CARRYING, carried)
    assert main(["identify-payload", str(carrying), "--robot", str(identified), "--json"]) == 0
    payload = json.loads(capsys.readouterr().out)
    mass, centre = documented("payload of an identified arm, largest error of mass and centre")[:2]
    assert payload["mass"] == pytest.approx(MASS, rel=1.2e-2 * mass)
    distance = np.linalg.norm(np.subtract(payload["center_of_mass"], CENTRE))
    assert 1e3 * distance <= 1.2 * centre
