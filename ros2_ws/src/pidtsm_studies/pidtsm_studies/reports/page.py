"""The page of every report: a single HTML file that works offline, rendered from templates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs


@dataclass(frozen=True)
class Section:
    """A section of a page with its heading.

    Attributes:
        id: id of the heading.
        heading: text.
        template: path of the template in this package.
        content: plain data for the template, available there as ``content``; sections without content are omitted.
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
        path: the HTML file; an existing one is replaced.
        title: title of the page, text.
        summary: a sentence below the title, text.
        sections: sections in their order.
        figures: plotly figures by the id of their plot; their numbers are arrays of float32, and a trace whose ``meta``
            is the value of a box named ``law`` is visible while that box is checked.
        arm: data for the animation, see `animation.animation`; None: no animation.

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
            script=_text("report.js") + (_text("arm.js") if arm else ""),
            plotly=get_plotlyjs() if figures else "",
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
