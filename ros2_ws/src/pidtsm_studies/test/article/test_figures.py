"""Figures 3 to 12 are complete, with laws, axes and the article's values."""

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.article import figures as article_figures
from pidtsm_studies.article.claims import ARTICLE_LAWS, Run
from pidtsm_studies.reports.figures import COLOURS, STYLE
from pidtsm_studies.reports.labels import CASES, LABELS

GAINS = {"piddtsm": 3.0, "pidnftsm": 2.0, "dtsm": 1.0}  # of stand-ins
EVENT = 1.5  # s


def run(case: str, law: str) -> Run:
    """Two seconds with the gains of a stand-in."""
    stand_in = rollout(controller={"law.k1": GAINS[law]}, duration=2.0)
    recording = replace(stand_in, scenario=case, law=law, event_time=EVENT if case == "case2" else None)
    return recording, recording.metrics()


@pytest.fixture(scope="module")
def reproduction() -> dict[tuple[str, str], Run | str]:
    return {(case, law): run(case, law) for case in CASES for law in ARTICLE_LAWS}


@pytest.fixture(scope="module")
def drawings(reproduction: dict[tuple[str, str], Run | str]) -> dict[str, dict[str, Figure]]:
    """By case and name."""
    made = {}
    for case in CASES:
        runs = {law: run for law in ARTICLE_LAWS if not isinstance(run := reproduction[case, law], str)}
        with matplotlib.rc_context(STYLE):
            made[case] = {draw.__name__: draw(case, runs) for draw in article_figures.FIGURES}
    return made


def test_all_ten_are_written_as_png_and_svg(tmp_path: Path, reproduction: dict[tuple[str, str], Run | str]) -> None:
    written = article_figures.write_article_figures(reproduction, tmp_path)
    assert [path.name for path in written] == [
        f"figure{figure:02}.{suffix}" for figure in range(3, 13) for suffix in ("png", "svg")
    ]
    assert all(path.stat().st_size > 5000 for path in written)


@pytest.mark.parametrize("case", CASES)
def test_lines_are_of_all_laws_each_in_its_colour(drawings: dict[str, dict[str, Figure]], case: str) -> None:
    figures = drawings[case]
    for name in ("tracking", "error", "control_inputs"):
        assert len(figures[name].axes) == 4
        for ax in figures[name].axes:
            colours = {line.get_label(): to_hex(line.get_color()).upper() for line in ax.lines}
            for style, law in enumerate(ARTICLE_LAWS):
                assert colours[LABELS[law]] == COLOURS[style].upper()
        (legend,) = (legend for ax in figures[name].axes if (legend := ax.get_legend()))
        expected = [LABELS[law] for law in ARTICLE_LAWS]
        expected = ["reference", *expected] if name == "tracking" else expected
        expected = [*expected, "event"] if case == "case2" else expected
        assert [text.get_text() for text in legend.get_texts()] == expected


def test_the_right_panel_shows_the_start_or_the_event(drawings: dict[str, dict[str, Figure]]) -> None:
    start = drawings["case1"]["control_inputs"].axes[1].get_xlim()
    event = drawings["case2"]["control_inputs"].axes[1].get_xlim()
    assert start[0] == 0.0
    assert event[0] == pytest.approx(EVENT - 1.0)


@pytest.mark.parametrize("case", CASES)
def test_bars_are_the_metrics(
    drawings: dict[str, dict[str, Figure]], reproduction: dict[tuple[str, str], Run | str], case: str
) -> None:
    for name, key in (("rmse", "rmse"), ("eci", "eci")):
        axes = drawings[case][name].axes
        for joint, ax in enumerate(axes):
            heights = [bar.get_height() for bar in ax.patches]  # type: ignore[attr-defined]
            runs = [run for law in ARTICLE_LAWS if not isinstance(run := reproduction[case, law], str)]
            assert heights == [metrics[key][joint] for _, metrics in runs]
            names = [text.get_text().partition("\n")[0] for text in ax.get_xticklabels()]
            assert names == [LABELS[law] for law in ARTICLE_LAWS]


def test_bars_of_the_rmse_are_marked_with_the_articles_values(drawings: dict[str, dict[str, Figure]]) -> None:
    first, second = (drawings[case]["rmse"].axes[0].lines for case in CASES)
    np.testing.assert_allclose(np.asarray(first[0].get_ydata()), [0.03808, 0.03808 / 0.75, 0.03808 / 0.5])
    np.testing.assert_allclose(np.asarray(second[0].get_ydata()), [0.03827])
    assert not drawings["case1"]["eci"].axes[0].lines


def test_axes_have_units(drawings: dict[str, dict[str, Figure]]) -> None:
    for case in CASES:
        for figure in drawings[case].values():
            for ax in figure.axes:
                assert ax.get_ylabel() == "" or ax.get_ylabel().endswith(")")
                assert ax.get_xlabel() in ("", "time (s)")


def test_a_law_that_did_not_run_is_left_out(tmp_path: Path, reproduction: dict[tuple[str, str], Run | str]) -> None:
    some = {key: run if key == ("case1", "dtsm") else "not finite after 1 s" for key, run in reproduction.items()}
    written = article_figures.write_article_figures(some, tmp_path)
    assert [path.stem for path in written if path.suffix == ".svg"] == [f"figure{figure:02}" for figure in range(3, 8)]
    assert "PIDDTSM" not in (tmp_path / "figure03.svg").read_text()
    assert not article_figures.write_article_figures({}, tmp_path / "none")
