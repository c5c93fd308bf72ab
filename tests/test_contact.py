"""What docs/contact.md says of contact and pushes."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import contact  # noqa: E402


def told(*first: str, cells: int) -> list[str]:
    """The cells of the row that begins with these and has so many more."""
    lines = contact.PAGE.read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")]
    (row,) = (row for row in rows if tuple(row[: len(first)]) == first and len(row) == len(first) + cells)
    return row[len(first) :]


@pytest.mark.parametrize("contender", ["piddtsm", "computed_torque", "piddtsm, practical"])
@pytest.mark.parametrize("limits", ["low", "of the arm, tracking limit"])
def test_a_controller_does_in_the_wall_what_the_page_says(contender: str, limits: str) -> None:
    run = contact.press(contender, limits)
    judged = contact.judge(run, limits)
    assert judged.torque <= 1.0
    torque, gain, within, after = told(contender, limits, cells=4)
    assert [float(torque), float(gain), float(within)] == pytest.approx(
        [judged.torque, judged.gain, 1e3 * judged.within], rel=0.2, abs=0.02
    )
    if limits == "low":
        assert judged.fault == ""
        assert judged.after < 0.01
        assert float(after) == pytest.approx(1e3 * judged.after, rel=0.2, abs=0.2)
    else:
        assert judged.fault == "TRACKING_LIMIT"
        assert judged.fault in after


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_a_push_does_what_the_page_says_on_both_engines(engine: str) -> None:
    error, recovery = contact.push("piddtsm, practical", engine)
    assert recovery is not None
    assert [float(cell) for cell in told("piddtsm, practical", cells=2)] == pytest.approx(
        [1e3 * error, recovery], rel=0.05
    )
