"""The page of the robustness study is complete, and a browser draws it."""

import re
from pathlib import Path

import pytest
from devtools import CHROMIUM, Page

from pidtsm_studies.robustness import figures
from pidtsm_studies.robustness.contenders import CONTENDERS, choose
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS
from pidtsm_studies.robustness.report import write_robustness_report
from pidtsm_studies.robustness.requirements import REQUIREMENTS
from pidtsm_studies.robustness.results import QUICK, Robustness
from pidtsm_studies.robustness.study import measure
from pidtsm_studies.robustness.wording import measured_text, tolerance_text


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, quick: Robustness) -> Path:
    path = tmp_path_factory.mktemp("robustness") / "report.html"
    write_robustness_report(path, quick)
    return path


def test_it_shows_everything_and_loads_nothing_from_outside(report: Path, quick: Robustness) -> None:
    page = report.read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)"', page) == ["rows", "tolerance", "curves", "method"]
    assert re.findall(r'class="plot" id="(\w+)"', page) == [imperfection.name for imperfection in IMPERFECTIONS]
    assert re.findall(r'name="law" value="(\w+)"', page) == [contender.name for contender in CONTENDERS]
    assert "default-src 'none'" in page
    assert f"has failed and has no such values: {quick.diverged} of {quick.runs} runs." in page
    assert f"The practical set meets all limits in {quick.met()} of {len(REQUIREMENTS)} rows" in page
    for requirement in REQUIREMENTS:
        assert requirement.label in page


def test_tables_have_every_value_and_verdict(report: Path, quick: Robustness) -> None:
    sections = report.read_text(encoding="utf-8").partition('<h2 id="rows">')[2]
    requirements, _, rest = sections.partition('<h2 id="tolerance">')
    verdicts = [
        kept
        for requirement, by_contender in zip(REQUIREMENTS, quick.achievements, strict=True)
        for achievement in by_contender.values()
        for quantity, kept in achievement.kept(requirement).items()
        if requirement.limits[quantity] != float("inf")
    ]
    assert re.findall(r'<td class="(\w+)">', requirements) == ["holds" if kept else "fails" for kept in verdicts]
    for by_contender in quick.achievements:
        for achievement in by_contender.values():
            assert all(f">{measured_text(value)}" in requirements for value in achievement.values.values())
    cells = re.findall(r"<td>([^<]*)</td>", rest.partition("</table>")[0])
    tolerated = [tolerance_text(quick, each, contender.name) for each in IMPERFECTIONS for contender in CONTENDERS]
    assert [cell for cell in cells if " to " not in cell] == tolerated


def test_the_same_results_give_the_same_file(tmp_path: Path, report: Path, quick: Robustness) -> None:
    write_robustness_report(tmp_path / "again.html", quick)
    assert (tmp_path / "again.html").read_bytes() == report.read_bytes()


def test_what_diverged_is_counted(tmp_path: Path, with_failures: Robustness) -> None:
    write_robustness_report(tmp_path / "report.html", with_failures)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"has failed and has no such values: 1 of {with_failures.runs} runs." in page
    assert "The practical set meets all limits in 0 of 6 rows" in page


def test_chosen_controllers_with_other_parameters_in_another_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = choose(["pid", "dtsm"], overrides=["simulator.limits.effort=[1.0, 1.0]"])
    robustness = measure(QUICK, contenders=chosen, scenario="case2")
    assert [contender.name for contender in robustness.contenders] == ["dtsm", "pid"]
    assert all(not curve.success.any() for curves in robustness.curves.values() for curve in curves.values())
    assert [list(by_contender) for by_contender in robustness.achievements] == [["dtsm", "pid"]] * len(REQUIREMENTS)
    write_robustness_report(tmp_path / "report.html", robustness)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'name="law" value="(\w+)"', page) == ["dtsm", "pid"]
    for text in ("DTSM meets all limits in 0 of", "imperfection of Case 2", "All with --set simulator.limits.effort="):
        assert text in page
    monkeypatch.setattr(figures, "IMPERFECTIONS", IMPERFECTIONS[:1])  # drawing takes a second each
    _, svg = figures.write_robustness_figures(robustness, tmp_path)
    text = svg.read_text(encoding="utf-8")
    assert "DTSM" in text
    assert "super-twisting" not in text


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")
def test_a_browser_draws_every_curve(page: Page, report: Path) -> None:
    page.open(report)
    for imperfection in IMPERFECTIONS:
        page.evaluate(f"document.getElementById('{imperfection.name}').scrollIntoView()")
        page.wait(f"document.querySelectorAll('#{imperfection.name} .scatterlayer .trace .js-line').length > 0")
    page.click('input[name="law"][value="dtsm"]')
    shown = "document.getElementById('noise')._fullData.filter(t => t.meta === '{}' && t.visible === true).length"
    assert page.evaluate(shown.format("dtsm")) == 0
    assert page.evaluate(shown.format("pid")) == 8  # a band and a line in each panel
    assert page.complaints == []
