"""The page that every report is: one HTML file that opens offline, made from the templates beside this module."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs


@dataclass(frozen=True)
class Section:
    """A part of a page under a heading of its own.

    Attributes:
        id: of the heading.
        heading: text.
        template: what renders the content, by its path in this package.
        content: plain data for the template, there as ``content``; a section without any is left out.
    """

    id: str
    heading: str
    template: str
    content: Any


def write_page(
    path: Path,
    title: str,
    summary: str,
    sections: Sequence[Section],
    figures: Mapping[str, Any],
    arm: Mapping[str, Any] | None = None,
) -> None:
    """Write a page in the style of the reports; the same arguments give the same file.

    Args:
        path: the HTML file; an old one is replaced.
        title: of the page, text.
        summary: a sentence below it, text.
        sections: in their order.
        figures: plotly's, by the id of the plot that they are drawn in; their numbers are arrays of float32, and a
            trace whose ``meta`` is the value of a box named ``law`` is shown while that box is checked.
        arm: what the animation needs, see `animation.animation`; None without one.

    Raises:
        ValueError: a number in `arm`, or one of a figure outside its arrays, is not finite.
    """
    page = (
        _environment()
        .get_template("reports/templates/page.html")
        .render(
            title=title,
            summary=summary,
            sections=[section for section in sections if section.content],
            data={"figures": {name: figure.to_dict() for name, figure in figures.items()}, "arm": arm},
            style=_text("report.css"),
            script=_text("report.js"),
            plotly=get_plotlyjs(),
        )
    )
    path.write_text(page, encoding="utf-8")


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("pidtsm_studies", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    return environment


def _text(name: str) -> str:
    return (files(__package__) / "templates" / name).read_text(encoding="utf-8")
