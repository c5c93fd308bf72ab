"""Content of the report."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pidtsm_core.recording import Recording
from pidtsm_core.signals import Fault, Mode, Signal, Status, Stop, Violation
from pidtsm_core.written import readable
from pidtsm_studies.article.claims import Run, compare
from pidtsm_studies.reports.labels import CASES
from pidtsm_studies.reports.report import write_report

RunOf: TypeAlias = Callable[[str, str], Run]

LAWS = ("piddtsm", "pidnftsm", "dtsm")
PLOTS = ["error", "effort", "position", "reference", "sliding", "manifold", "gain"]
FOLDED = ["happened", "curves"]
NOTE = "DTSM with the printed kappa ends at 0.5 s <not a tag> & so on."


class Outline(HTMLParser):
    """Tags with their attributes, and text outside scripts and styles."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.data: dict[str, Any] = {}
        self._inside = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = "data" if dict(attrs).get("id") == "data" else tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "data":
            self.data = json.loads(data)
        elif self._inside not in ("script", "style"):
            self.text += data

    def ids(self, tag: str) -> list[str]:
        return [attributes["id"] or "" for name, attributes in self.tags if name == tag and "id" in attributes]


def test_it_has_all_sections_and_plots(report: Path, reproduction: dict[tuple[str, str], Run | str]) -> None:
    outline = Outline(report)
    assert outline.ids("h2") == ["motion", "metrics", "more-metrics", "article", "deviations", *FOLDED]
    viewer = outline.data["viewer"]
    assert [[plot["id"] for plot in viewer["cases"][case]["plots"]] for case in CASES] == [PLOTS, PLOTS]
    drawn = [attributes["data-plot"] for tag, attributes in outline.tags if "data-plot" in attributes]
    assert drawn == PLOTS
    assert sorted(viewer["arm"]["runs"]) == sorted(f"{case} {law}" for case in CASES for law in LAWS)
    assert NOTE in outline.text
    assert str(reproduction["case1", "dtsm_printed"]) in outline.text
    assert "7 runs: 6 runs of 2 s, 2000 samples, without ROS; 1 without curves" in outline.text


def test_every_comparison_is_in_its_table_with_its_reason(
    report: Path, reproduction: dict[tuple[str, str], Run | str]
) -> None:
    text = Outline(report).text
    links = {attributes.get("href") for tag, attributes in Outline(report).tags if tag == "a"}
    for each in compare(reproduction):
        claim = each.claim
        for part in (claim.quantity, claim.printed(), each.project, claim.printed_in, claim.reason):
            assert readable(part) in text
    assert {f"#{i}" for i in Outline(report).ids("li")} <= links


def test_statements_that_are_not_true_are_a_list(report: Path, reproduction: dict[tuple[str, str], Run | str]) -> None:
    section = report.read_text(encoding="utf-8").partition('<h2 id="deviations">')[2]
    judged = [each for each in compare(reproduction) if each.holds is not None]
    false = [each for each in judged if not each.holds]
    assert false
    assert f"{len(judged) - len(false)} of {len(judged)} statements and limits" in section
    statements = re.findall("<li>(.*)</li>", section.partition("</details>")[0])
    assert len(statements) == len(false)
    for statement, each in zip(statements, false, strict=True):
        assert f"joint {each.claim.joint + 1}: " in statement


def test_it_loads_nothing_from_outside(report: Path) -> None:
    for tag, attributes in Outline(report).tags:
        assert tag not in ("iframe", "object", "embed", "img")
        assert "src" not in attributes
        assert str(attributes.get("href", "#")).startswith(("#", "data:"))
    assert "default-src 'none'" in report.read_text(encoding="utf-8")


def test_links_and_labels_lead_somewhere(report: Path) -> None:
    outline = Outline(report)
    ids = [attributes["id"] for _, attributes in outline.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in outline.tags:
        for key in ("aria-labelledby", "for"):
            assert key not in attributes or attributes[key] in ids
        href = attributes.get("href") or ""
        assert not href.startswith("#") or href[1:] in ids


def test_tables_have_a_caption_and_heads(report: Path) -> None:
    tags = [tag for tag, _ in Outline(report).tags]
    assert tags.count("table") == tags.count("caption") > 4
    assert all("scope" in attributes for tag, attributes in Outline(report).tags if tag == "th")


def test_the_same_runs_give_the_same_file(
    tmp_path: Path, report: Path, reproduction: dict[tuple[str, str], Run | str]
) -> None:
    write_report(tmp_path / "again.html", reproduction, compare(reproduction), [NOTE])
    assert (tmp_path / "again.html").read_bytes() == report.read_bytes()


def test_a_long_reproduction_stays_small(tmp_path: Path, run_of: RunOf) -> None:
    recording, metrics = run_of("case1", "piddtsm")
    random = np.random.default_rng(0)
    samples = 30_000
    noise = Recording(
        **{
            **vars(recording),
            "time": np.arange(samples) / 1000,
            "position": random.normal(size=(samples, 2)),
            "effort": random.normal(size=(samples, 2)),
            "reference": random.normal(size=(samples, 3, 2)),
            "signals": random.normal(size=(samples, len(Signal), 2)),
            "status": np.zeros((samples, len(Status)), dtype=np.uint8),
        }
    )
    runs = {(case, f"law{n}"): (noise, metrics) for case in CASES for n in range(6)}
    write_report(tmp_path / "report.html", runs)
    assert (tmp_path / "report.html").stat().st_size < 4e6


def test_a_single_run_has_no_comparison(arms: dict[str, Path]) -> None:
    outline = Outline(arms["two_link"])
    assert outline.ids("h2") == ["motion", "metrics", *FOLDED, "made"]
    assert "Case 1, PIDDTSM" in outline.text
    assert ("input", "run") not in [(tag, attributes.get("name")) for tag, attributes in outline.tags]


def renamed(recording: Recording, *joints: str) -> Recording:
    return replace(recording, joints=joints, robot={**recording.robot, "joints": joints})


def happened(path: Path) -> str:
    """HTML of the section."""
    return path.read_text(encoding="utf-8").partition('<h2 id="happened">')[2].partition("</section>")[0]


def test_unusual_events_are_shown_and_marked(tmp_path: Path, run_of: RunOf) -> None:
    recording, _ = run_of("case1", "piddtsm")
    status = recording.status.copy()
    status[500:700] = (Mode.STOPPED, Fault.VELOCITY_LIMIT, 1, Violation.VELOCITY, Stop.HOLD)
    odd = replace(renamed(recording, "<b>", "joint2"), status=status, rejected={"controller": 2})
    write_report(tmp_path / "report.html", (odd, odd.metrics()))
    outline = Outline(tmp_path / "report.html")
    (run,) = outline.data["viewer"]["runs"].values()
    marks = [(event["kind"], event["time"]) for event in run["events"] if event["kind"] != "learnt"]
    assert marks == [("fault", 0.5), ("mode", 0.5), ("mode", 0.7)], "the limit has no mark beside that of its stop"
    assert "Stops: <b> is beyond limits.velocity at 0.5" in outline.text
    section = happened(tmp_path / "report.html")
    assert "stopped at 0.5 s: &lt;b&gt; is beyond limits.velocity; reset at 0.7 s" in section
    assert "messages rejected: controller 2" in section


def test_of_several_runs_the_unusual_ones_are_named(tmp_path: Path, run_of: RunOf) -> None:
    bad, good = run_of("case1", "dtsm"), run_of("case1", "piddtsm")
    lost = replace(bad[0], position=bad[0].position + 4.0)
    write_report(tmp_path / "report.html", {("case1", "dtsm"): (lost, lost.metrics()), ("case1", "piddtsm"): good})
    section = happened(tmp_path / "report.html")
    assert "<h3>Case 1, DTSM</h3>" in section
    assert "ran away" in section.partition("<h3>Case 1, DTSM</h3>")[2].partition("<h3>")[0]


def test_a_run_that_ran_away_has_no_errors_to_compare(tmp_path: Path, run_of: RunOf) -> None:
    recording, _ = run_of("case1", "piddtsm")
    lost = replace(recording, position=recording.position + 4.0)
    write_report(tmp_path / "report.html", (lost, lost.metrics()))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('<span title="ran away">ran away</span>') == 4 * 2
    assert f"{lost.metrics()['rmse'][0]:.5g}" not in Outline(tmp_path / "report.html").text


def test_a_run_without_metadata_is_reported(tmp_path: Path, run_of: RunOf) -> None:
    recording, _ = run_of("case1", "piddtsm")
    nameless = replace(recording, scenario=None, law=None, clock=None)
    write_report(tmp_path / "report.html", (nameless, nameless.metrics()))
    assert "unknown law" in Outline(tmp_path / "report.html").text


def test_an_arm_whose_description_is_gone_is_not_drawn(tmp_path: Path, run_of: RunOf) -> None:
    recording, metrics = run_of("case1", "piddtsm")
    gone = replace(recording, robot={**recording.robot, "robot.description": "/gone/<b>.urdf"})
    write_report(tmp_path / "report.html", (gone, metrics))
    outline = Outline(tmp_path / "report.html")
    assert outline.ids("svg") == []
    assert outline.data["viewer"]["arm"] is None
    assert "The arm is not drawn: robot.description: /gone/<b>.urdf: No such file or directory" in outline.text


def test_each_joint_has_its_own_units(tmp_path: Path, run_of: RunOf) -> None:
    recording = replace(run_of("case2", "piddtsm")[0], slides=(False, True))
    write_report(tmp_path / "report.html", (recording, recording.metrics()))
    outline = Outline(tmp_path / "report.html")
    titles = [attributes["title"] or "" for tag, attributes in outline.tags if tag == "data"]
    for units, metrics in ((("rad", "m"), 3), (("N m", "N"), 2), (("N m/s", "N/s"), 1)):
        for unit in units:
            assert [title.partition(" ")[2] for title in titles].count(unit) == metrics
    assert "below 10⁻³ rad or m" in outline.text
    assert "more than 5 N m or N" in outline.text
    plots = outline.data["viewer"]["cases"]["case2"]["plots"]
    shown = {(plot["quantity"], *plot["joints"]): plot["unit"] for plot in plots}
    for quantity, pair in (("error", ("rad", "m")), ("effort", ("N m", "N"))):
        for joint, unit in enumerate(pair):
            assert shown[quantity, joint].removeprefix("m" if unit != "m" else "") in (unit, "mm")


def test_names_cannot_break_the_page(tmp_path: Path, run_of: RunOf) -> None:
    recording, _ = run_of("case1", "piddtsm")
    odd = replace(renamed(recording, "<i>", "&amp;"), scenario="</script><b>", law='a"><script>alert(1)</script>')
    write_report(tmp_path / "report.html", (odd, odd.metrics()))
    plain = Outline(tmp_path / "report.html")
    assert not {"i"} & {tag for tag, _ in plain.tags}
    assert [tag for tag, _ in plain.tags].count("script") == 3
    assert plain.data["viewer"]["arm"] is not None
    assert "<i>" in plain.text
