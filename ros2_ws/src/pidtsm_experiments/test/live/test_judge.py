"""Live verdicts: the window has what a recorder would have, and a verdict comes and goes with its cause."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pidtsm_core.signals import Mode, Signal
from pidtsm_experiments.live.judge import Window, judge, judged_arm
from pidtsm_experiments.live.stream import Batch
from pidtsm_experiments.live.verdicts import verdict_list
from pidtsm_studies.blind.arms import blind_arm
from pidtsm_studies.blind.observe import observe
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.observed import Observed

SECONDS, PIECE = 8.0, 100


def feed(window: Window, seen: Observed, begin: float) -> None:
    """Let a recording arrive in pieces, from a time (s) on; its joint states have the joints in another order."""
    stamps = np.round(1e9 * (begin + seen.time)).astype(np.int64)
    assert seen.command is not None
    assert seen.reference is not None
    said = np.zeros((len(stamps), len(Signal), len(seen.joints)))
    # A filtered position, which must not be taken for the measured one.
    said[:, Signal.POSITION] = 0.0
    said[:, Signal.POSITION_ERROR] = -seen.reference
    said[:, Signal.EFFORT] = seen.command
    measured = np.stack([seen.position, np.full_like(seen.position, np.nan), seen.effort], axis=1)
    state = SimpleNamespace(name=list(seen.joints), mode=Mode.FOLLOWING, fault=0)
    sensors = SimpleNamespace(name=list(seen.joints)[::-1])
    for k in range(0, len(stamps), PIECE):
        part = slice(k, k + PIECE)
        answered = np.isfinite(said[part]).all(axis=(1, 2))
        window.add(
            Batch(stamps[part], measured[part, :, ::-1], sensors),
            Batch(stamps[part][answered], said[part][answered], state) if answered.any() else None,
        )


def test_a_verdict_comes_and_goes_with_its_cause(tmp_path: Path) -> None:
    made = {
        cause: blind_arm(3, tmp_path, "scara", [cause] if cause else [], "", SECONDS)
        for cause in (None, Cause.NOISY_ENCODER)
    }
    seen = {cause: observe(each.experiment) for cause, each in made.items()}
    arm, robot = judged_arm(made[None].experiment.settings["controller"])
    window, page = Window(SECONDS - 1.0), tmp_path / "page.html"
    found = []
    for i, cause in enumerate((None, Cause.NOISY_ENCODER, None)):
        feed(window, seen[cause], 100.0 + i * SECONDS)
        found.append(judge(window, arm, robot, page))
    assert [each["found"] for each in found] == [[], ["noisy_encoder"], []]
    assert "This run is good" in verdict_list(found[0], "12:00:00")
    shown = verdict_list(found[1], "12:00:08")
    assert "noisy encoder" in shown
    assert found[1]["verdicts"][0]["cure"] in shown
    assert "This run is good" in page.read_text()


def test_the_window_has_what_a_recorder_would_have(tmp_path: Path) -> None:
    seen = observe(blind_arm(3, tmp_path, "scara", [Cause.LOST_SAMPLES], "", 4.0).experiment)
    window = Window()
    feed(window, seen, 5.0)
    kept = window.observed()
    assert kept is not None
    rows = slice(0, len(kept.time))
    np.testing.assert_allclose(kept.time, seen.time[rows] - seen.time[0], atol=1e-9)
    assert len(seen.time) - len(kept.time) < 2 * PIECE
    for name in ("position", "effort", "command", "reference"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(seen, name)[rows])
    assert kept.joints == seen.joints
