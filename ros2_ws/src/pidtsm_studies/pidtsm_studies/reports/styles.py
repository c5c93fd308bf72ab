"""Colours and dashes of the lines of the pages: each differs from the others in lightness and in its dashes, too."""

from typing import NamedTuple


class Style(NamedTuple):
    """The look of a line.

    Attributes:
        light: its colour on white, with a contrast of at least 4.5.
        dark: its colour on the dark background, likewise.
        dashes: lengths of dashes and gaps, px; empty: solid.
    """

    light: str
    dark: str
    dashes: tuple[int, ...]


SERIES = (
    Style("#0072b2", "#5cb8ff", ()),
    Style("#b04a00", "#ff9d52", (9, 3)),
    Style("#1a1a1a", "#f2f2f2", (2, 2)),
    Style("#007a58", "#3fd6a5", (9, 3, 2, 3)),
    Style("#9c3d96", "#e59ad9", (14, 4)),
    Style("#776000", "#e8cf4f", (5, 2)),
    Style("#882255", "#ff86ae", (9, 2, 2, 2, 2, 2)),
    Style("#4d6d8a", "#a9c0d6", (3, 5)),
)
"""Styles in their order, after Okabe and Ito, darker on white and lighter on black."""


def looks(style: int) -> dict[str, object]:
    """Number of the colour, and dashes, of a style; when colours come again they have other dashes."""
    colour = style % len(SERIES)
    return {"colour": colour, "dashes": list(SERIES[(style + style // len(SERIES)) % len(SERIES)].dashes)}
