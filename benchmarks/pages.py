"""Sizes of the pages, and how long a browser takes to draw them.

./pidtsm shell -c "python benchmarks/pages.py"

Each page is opened several times beside an empty one; the median counts, from the start of the navigation until the
second picture of the browser after its scripts.
"""

import json
import re
import statistics
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import trimesh

from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.recording import Recording
from pidtsm_core.robots.source import read_source
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.comparison import write_comparison
from pidtsm_studies.reports.report import write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.devtools import Page, browser

DURATION = 30.0
"""Of the runs, s."""
_FRAME = """(() => {
    const slider = document.getElementById('time'), begin = performance.now();
    for (let k = 0; k < 50; k++) { slider.value = 0.5 * k; slider.dispatchEvent(new Event('input')); }
    return (performance.now() - begin) / 50;
})()"""
OPENED = 5
"""How often each page is opened."""
_DRAWN = "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn(performance.now()))))"


def with_meshes(folder: Path) -> Path:
    """The Panda, with a mesh of 20,480 triangles for each of its links, as makers publish them."""
    text = read_source("panda")[1]
    for number, primitive in enumerate(re.findall(r"<visual>.*?</visual>", text, re.DOTALL)):
        file = folder / f"{number}.stl"
        rod = trimesh.creation.icosphere(5, 0.06)
        rod.apply_scale((1.0, 1.0, 2.5))
        rod.export(file)
        text = text.replace(primitive, f'<visual><geometry><mesh filename="{file}"/></geometry></visual>', 1)
    arm = folder / "panda.urdf"
    arm.write_text(text, encoding="utf-8")
    return arm


def written(folder: Path) -> dict[str, Path]:
    """Pages of runs of 30 s at 1 kHz by their names."""
    recordings: dict[str, Recording] = {
        "2 joints": rollout(duration=DURATION),
        "4 joints": rollout(robot="scara", params=PRACTICAL, duration=DURATION),
        "7 joints": rollout(robot="panda", params=PRACTICAL, duration=DURATION),
    }
    solid = {**recordings["7 joints"].robot, "robot.description": str(with_meshes(folder))}
    recordings["7 joints with meshes"] = replace(recordings["7 joints"], robot=solid)
    pages = {}
    for name, recording in recordings.items():
        pages[name] = folder / f"{name}.html"
        write_report(pages[name], (recording, recording.metrics()))
    solid_run = recordings["7 joints with meshes"]
    run: Run = (solid_run, solid_run.metrics())
    for count in (2, 8):
        name = f"7 joints with meshes, {count} runs"
        pages[name] = folder / f"{name}.html"
        write_comparison(pages[name], {f"run {n}": run for n in range(1, count + 1)}, {})
    return pages


def time_to_draw(page: Page, file: Path) -> float:
    """Median time until a page is drawn, s."""
    times = []
    for _ in range(OPENED):
        page.open(file, 1280, 900)
        times.append(page.evaluate(_DRAWN) / 1e3)
    return statistics.median(times)


def frame(page: Page) -> float:
    """Mean time in which the page that is open moves arm, curves and values to another time, s."""
    return float(page.evaluate(_FRAME)) / 1e3


def main() -> None:
    """Print size, time, the time above that of an empty page, and that of a picture of the motion, of each page."""
    rows = []
    with tempfile.TemporaryDirectory() as name, browser(Path(name) / "profile") as page:
        folder = Path(name)
        empty = folder / "empty.html"
        empty.write_text("<!DOCTYPE html><title>empty</title>", encoding="utf-8")
        floor = time_to_draw(page, empty)
        for title, file in written(folder).items():
            drawn = time_to_draw(page, file)
            above = drawn - floor
            size = round(file.stat().st_size / 1e6, 3)
            rows.append((title, size, round(drawn, 3), round(above, 3), round(1e3 * frame(page), 2)))
    for row in rows:
        print(json.dumps(dict(zip(("page", "MB", "s", "s above an empty page", "ms a frame"), row, strict=True))))


if __name__ == "__main__":
    main()
