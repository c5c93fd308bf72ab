"""All figures of any run are written as small files without losing spikes."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal, Status
from pidtsm_studies.reports import figures

NAMES = ["tracking", "error", "torque", "sliding_variables", "adaptive_gain"]


@pytest.fixture(scope="module")
def recording() -> Recording:
    return rollout(duration=2.0)


def noisy(joints: int, samples: int, slides: tuple[bool, ...] = ()) -> Recording:
    """Worst case for the file size: noise everywhere, and saturation at every second sample."""
    random = np.random.default_rng(0)
    signals = random.normal(size=(samples, len(Signal), joints))
    signals[:, Signal.SATURATED] = (np.arange(samples) % 2)[:, None]
    stamps = np.arange(samples, dtype=np.int64) * 1_000_000
    return Recording(
        joints=tuple(f"joint{j + 1}" for j in range(joints)),
        time=stamps / 1e9,
        stamps_ns=stamps,
        position=random.normal(size=(samples, joints)),
        velocity=random.normal(size=(samples, joints)),
        effort=random.normal(size=(samples, joints)),
        reference=random.normal(size=(samples, 3, joints)),
        signals=signals,
        status=np.zeros((samples, len(Status)), dtype=np.uint8),
        compute_time=np.full(samples, 1e-5),
        scenario=None,
        law=None,
        clock=None,
        event_time=samples / 2000,
        slides=slides,
    )


def test_every_figure_is_written_as_png_and_svg_the_same_for_the_same_run(tmp_path: Path, recording: Recording) -> None:
    before = dict(matplotlib.rcParams)
    written = figures.write_figures(recording, tmp_path / "new" / "figures")
    assert [path.name for path in written] == [f"{name}.{suffix}" for name in NAMES for suffix in ("png", "svg")]
    for path in written:
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG")
        else:
            assert ET.parse(path).getroot().tag.endswith("svg")
    assert dict(matplotlib.rcParams) == before
    again = figures.write_figures(recording, tmp_path / "again")
    for one, other in zip(written, again, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_the_files_of_seven_joints_stay_small(tmp_path: Path) -> None:
    for path in figures.write_figures(noisy(7, 30_000), tmp_path):
        assert path.stat().st_size < (600_000 if path.suffix == ".svg" else 2_000_000), path.name


@pytest.mark.parametrize("draw", figures.FIGURES.values(), ids=NAMES)
def test_axes_have_units_and_the_event(recording: Recording, draw: Any) -> None:
    figure = draw(replace(recording, event_time=1.0))
    for ax in figure.axes:
        assert not ax.get_xlabel() or ax.get_xlabel() == "time (s)"
        assert not ax.get_ylabel() or ax.get_ylabel().endswith(")")
    (legend,) = legends(figure)
    assert "event" in [text.get_text() for text in legend.get_texts()]
    assert "event" not in [line.get_label() for ax in draw(recording).axes for line in ax.lines]


def legends(figure: Figure) -> list[Any]:
    return [ax.get_legend() for ax in figure.axes if ax.get_legend()]


@pytest.mark.parametrize("draw", figures.FIGURES.values(), ids=NAMES)
def test_joints_of_different_kinds_never_share_a_panel(draw: Any) -> None:
    recording = replace(noisy(5, 20, (False, True, False, False, False)), law="piddtsm")
    figure = draw(recording)
    for ax in figure.axes:
        drawn = {str(line.get_label()) for line in ax.lines} & set(recording.joints)
        named = {joint for joint in recording.joints if joint in ax.get_ylabel()} or drawn
        assert len(named) <= 3
        assert named in ({"joint2"}, named - {"joint2"})
        if unit := re.search(r"\((rad|m|N m|N)\b", ax.get_ylabel()):
            assert (unit[1] in ("m", "N")) == (named == {"joint2"})
    for j in recording.joints:
        assert any(j in f"{ax.get_ylabel()} {[line.get_label() for line in ax.lines]}" for ax in figure.axes), j


def test_every_group_of_joints_has_its_legend() -> None:
    names = [[text.get_text() for text in legend.get_texts()] for legend in legends(figures.error(noisy(7, 20)))]
    expected = [["joint1", "joint2", "joint3"], ["joint4", "joint5"], ["joint6", "joint7"]]
    assert [[name for name in each if name != "event"] for each in names] == expected


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("samples", [1, 2, 3])
def test_very_short_runs_are_drawn(tmp_path: Path, samples: int) -> None:
    assert len(figures.write_figures(noisy(1, samples), tmp_path)) == 10


@pytest.mark.filterwarnings("error")
def test_a_run_without_any_error_is_drawn(tmp_path: Path, recording: Recording) -> None:
    still = replace(recording, reference=recording.position[:, None].repeat(3, axis=1), signals=0 * recording.signals)
    assert len(figures.write_figures(still, tmp_path)) == 10


@given(st.integers(1, 20_000), st.integers(0, 2**32 - 1))
def test_decimation_keeps_every_extreme(samples: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    time = np.cumsum(random.exponential(size=samples))
    values = random.normal(size=samples)
    kept_time, kept = figures.decimated(time, values)
    assert kept_time.size == kept.size <= 2 * figures.PARTS + 2
    assert (kept_time[0], kept_time[-1]) == (time[0], time[-1])
    assert np.all(np.diff(kept_time) > 0)
    assert np.isin(kept, values).all()
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert figures.envelope(time, values)[1].max() == values.max()
