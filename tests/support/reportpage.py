"""What a report in a browser shows: curves, the arm, and values at the cursor."""

import math
import re

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from support.devtools import Page

STATE = "data.viewer.state"
END, HOME, LEFT, UP, RIGHT, DOWN, SPACE = 35, 36, 37, 38, 39, 40, 32
"""Codes of keys."""


def plotted(page: Page, plot: str, what: str) -> object:
    """Something of a uPlot."""
    return page.evaluate(f"document.getElementById('plot-{plot}').plot.{what}")


def lines(page: Page, plot: str = "error") -> list[str]:
    """What the lines of a plot are of: run and joint."""
    found: list[str] = page.evaluate(
        f"document.getElementById('plot-{plot}').lines.map((each) => each.run.key + ' ' + each.joint)"
    )
    return found


def arm(page: Page, part: str = "links-0") -> Array:
    """Points of a part of the drawing, shape (points, 2)."""
    path = page.evaluate(f"document.getElementById('arm-{part}')?.getAttribute('d') ?? ''")
    return np.array(re.findall(r"[-\d.]+", path), dtype=np.float64).reshape(-1, 2)


def seen(page: Page, points: Array, azimuth: float, elevation: float) -> Array:
    """Where the page must draw points, shape (points, 3), m, that are seen from a direction (degrees); in mm."""
    centre = page.evaluate("data.viewer.arm.centre")
    a, e = math.radians(azimuth), math.radians(elevation)
    right = -math.sin(a), math.cos(a), 0.0
    up = -math.cos(a) * math.sin(e), -math.sin(a) * math.sin(e), math.cos(e)
    return 1e3 * (points - centre) @ np.array([right, up]).T * [1.0, -1.0]


def at_the_end(page: Page, recording: Recording) -> int:
    """Move the slider to the end; returns the sample of the run."""
    page.focus("#time")
    page.key("End", END)
    page.wait(f"Number(document.getElementById('time').value) > {recording.time[-1] - 0.1}")
    return round(page.evaluate(f"{STATE}.time") * 1000)


def read(page: Page, joint: int, what: int) -> str:
    """A cell of the values at the cursor of a single run: what is 1 for the error, 2 for the effort."""
    across = page.evaluate("data.viewer.joints.length > 3")
    row, column = (what, joint + 1) if across else (joint + 1, what)
    return str(page.evaluate(f"document.getElementById('readout').rows[{row}].cells[{column}].textContent"))


def in_si(text: str) -> float:
    """The value of a quantity as written."""
    value, unit = re.fullmatch(r"(\S+?)\u202f(.*)", text.replace("\u202f×\u202f10", "e")).groups()  # type: ignore[union-attr]
    prefix = {"m": 1e-3, "µ": 1e-6, "n": 1e-9}.get(unit[0], 1.0) if len(unit) > 1 and unit != "N m" else 1.0
    powers = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    return float(value.translate(powers)) * prefix


def painted(page: Page, colour: str = "alpha > 128") -> list[float]:
    """Left, top, right and bottom of what is painted of the solid arm in such a colour, px; empty: nothing."""
    found: list[float] = page.evaluate(
        f"""(() => {{
            const canvas = document.getElementById('solid'), [w, h] = [canvas.width, canvas.height];
            const bytes = canvas.getContext('2d').getImageData(0, 0, w, h).data;
            const at = Array.from({{length: w * h}}, (_, i) => i).filter((i) => {{
                const [red, green, blue, alpha] = bytes.subarray(4 * i, 4 * i + 4);
                return {colour};
            }});
            const [xs, ys] = [at.map((i) => i % w), at.map((i) => Math.floor(i / w))];
            const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
            const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);
            return at.length ? [least(xs), least(ys), most(xs), most(ys)] : [];
        }})()"""
    )
    return found
