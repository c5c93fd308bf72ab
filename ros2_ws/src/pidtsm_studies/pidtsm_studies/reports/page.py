"""The page of every report: a single HTML file that works offline, rendered from templates.

Every page has the same order: a verdict, four answers, what moves and its curves, a matrix, and the rest folded.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from pidtsm_core.written import number, quantity, readable
from pidtsm_studies.reports.styles import SERIES

GOOD, BAD, PLAIN = "good", "bad", "plain"
"""State of a verdict."""
_SCRIPTS = ("written", "page", "plots", "meshes", "arm", "viewer", "charts", "filter")
"""Parts of the script, in their order."""


@dataclass(frozen=True)
class Section:
    """A section of a page with its heading.

    Attributes:
        id: id of the heading.
        heading: text.
        template: path of the template in this package.
        content: plain data for the template, available there as ``content``; sections without content are omitted.
        folded: whether the reader opens it.
    """

    id: str
    heading: str
    template: str
    content: Any
    folded: bool = False


@dataclass(frozen=True)
class Answer:
    """A question that every reader has, and its answer.

    Attributes:
        question: text.
        text: the answer, a few words.
        detail: a sentence.
        state: `GOOD`, `BAD` or `PLAIN`.
    """

    question: str
    text: str
    detail: str = ""
    state: str = PLAIN


@dataclass(frozen=True)
class Page:
    """A page.

    Attributes:
        title: what it is about, text.
        verdict: a sentence with the one figure that matters.
        state: of the verdict: `GOOD`, `BAD` or `PLAIN`.
        summary: a line about where the data come from.
        answers: in their order.
        sections: in their order.
        viewer: data for viewer.js, see `viewer.viewer_data`; None: nothing moves.
        charts: data for charts.js by id, see `charts.chart`.
    """

    title: str
    verdict: str
    state: str
    summary: str
    answers: Sequence[Answer]
    sections: Sequence[Section]
    viewer: Mapping[str, Any] | None = None
    charts: Mapping[str, Any] = field(default_factory=dict)


def write_page(path: Path, page: Page) -> None:
    """Write a page; the same page gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        page: its content.

    Raises:
        ValueError: a number in the data is not finite.
    """
    text = (
        _environment()
        .get_template("reports/templates/page.html")
        .render(
            page=page,
            sections=[section for section in page.sections if section.content],
            data={"viewer": page.viewer, "charts": page.charts},
            series=SERIES,
            style=_text("uplot/uPlot.min.css") + _text("page.css"),
            script="\n".join(_text(f"{name}.js") for name in _SCRIPTS),
            uplot=_text("uplot/uPlot.iife.min.js") if page.viewer or page.charts else "",
        )
    )
    path.write_text(text, encoding="utf-8")


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("pidtsm_studies", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    environment.filters.update(number=number, quantity=quantity, readable=readable)
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    return environment


def _text(name: str) -> str:
    return (files(__package__) / "templates" / name).read_text(encoding="utf-8")
