"""The leaderboard: laws and arms, as a page and as a document."""

import textwrap
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from pidtsm_core.errors import UsageError
from pidtsm_studies.reports.figures import COLOURS, DASHES, STYLE, save_figures
from pidtsm_studies.score.criteria import criteria_of, extent_of
from pidtsm_studies.score.groups import behind_the_best, by_arm, ceiling, table_of
from pidtsm_studies.score.page import axis_text, curve_of, success, write_score_page
from pidtsm_studies.score.results import FILE, Entry, read_entry
from pidtsm_studies.score.tasks import ON_HARDWARE
from pidtsm_studies.score.wording import COLUMNS, COLUMNS_ON_HARDWARE, cells, cells_on_hardware, title

_WIDTH = 32
"""Characters of a line below a panel; longer ones run into the next panel."""
_INTRODUCTION = """# Leaderboard

`./pidtsm leaderboard` writes this page from the results of `./pidtsm score`; [Score](score.md) describes what is
measured. The best score comes first. RMSE is the root of the sum of squares of the joints (rad, m for a joint that
slides), ECI and effort variation are sums (N m, N). The interval of a score covers other seeds.
"""
_QUICK = """**Quick scores**, of {values} values and {repeats} seed: they only show that everything runs, and cannot be
compared with others.
"""


def read_entries(folder: Path) -> list[Entry]:
    """All scores below a folder, in the order of their paths.

    Raises:
        UsageError: there are none, one is not readable, two have the same name, or their extents differ.
    """
    files = sorted(folder.rglob(FILE))
    if not files:
        raise UsageError(f"{folder}: no {FILE} below this folder; ./pidtsm score makes them")
    entries = [read_entry(file) for file in files]
    known: dict[tuple[str, str, str], Path] = {}
    for file, entry in zip(files, entries, strict=True):
        alike = next(each for each in entries if each.task.base == entry.task.base)
        if entry.extent != alike.extent:
            other = files[entries.index(alike)]
            raise UsageError(f"{file} has another number of runs than {other}: a quick score cannot be compared")
        other = known.setdefault((entry.task.robot, table_of(entry), title(entry)), file)
        if other != file:
            raise UsageError(f"{file} and {other} are both {title(entry)} on {entry.task.robot}; remove one")
    return entries


def write_leaderboard(folder: Path, entries: Sequence[Entry]) -> None:
    """Write ``leaderboard.html``, ``leaderboard.md`` and the figures of the latter.

    Args:
        folder: an existing folder.
        entries: of any arms, at least one.
    """
    write_score_page(folder / "leaderboard.html", "Leaderboard", entries)
    arms = by_arm(entries)
    names = sorted({title(entry) for entry in entries})  # A controller looks the same on every arm.
    drawings = {f"leaderboard-{arm}": partial(_figure, scored, names) for arm, scored in arms.items()}
    save_figures(drawings, folder / "images")
    (folder / "leaderboard.md").write_text(document(entries), encoding="utf-8")


def document(entries: Sequence[Entry]) -> str:
    """Content of ``leaderboard.md``."""
    extent = entries[0].extent
    quick = (
        []
        if extent == extent_of(entries[0].task.base, quick=False)
        else [_QUICK.format(values=extent.values, repeats=extent.repeats)]
    )
    return "\n".join([_INTRODUCTION, *quick, *(_arm(arm, scored) for arm, scored in by_arm(entries).items())])


def _arm(arm: str, entries: Sequence[Entry]) -> str:
    if entries[0].task.base == ON_HARDWARE:
        columns, oracle = [*COLUMNS_ON_HARDWARE], ceiling(entries)
        rows = [cells_on_hardware(entry, oracle, behind_the_best(entry, entries)) for entry in entries]
    else:
        columns, rows = [*COLUMNS], [cells(entry) for entry in entries]
    lines = [_row(columns), _row(["---"] * len(columns)), *map(_row, rows)]
    return "\n".join([f"## {arm}", "", *lines, "", f"![Success over every range](images/leaderboard-{arm}.png)", ""])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _figure(entries: Sequence[Entry], names: Sequence[str]) -> Figure:
    """One panel per range, one line per controller."""
    ranges = [(criterion, each) for criterion in criteria_of(entries[0].task.base) for each in criterion.ranges]
    figure = Figure(figsize=(9.0, 2.0 * -(-len(ranges) // 3)), layout="constrained")
    panels = figure.subplots(-(-len(ranges) // 3), 3, sharey=True, squeeze=False).flat
    for panel in panels[len(ranges) :]:
        panel.set_visible(False)
    for panel, (criterion, each) in zip(panels[: len(ranges)], ranges, strict=True):
        for entry in entries:
            style = names.index(title(entry))
            colour, dashes = COLOURS[style % len(COLOURS)], DASHES[(style + style // len(COLOURS)) % len(DASHES)]
            panel.plot(*success(curve_of(entry, criterion, each)), color=colour, linestyle=dashes, label=title(entry))
        panel.set_xlabel(textwrap.fill(axis_text(each), _WIDTH))
        panel.set_xscale("log" if each.logarithmic else "linear")
        panel.set_xlim(each.first, each.last)
    figure.supylabel("success", fontsize=STYLE["axes.labelsize"])
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure
