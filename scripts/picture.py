"""The moving picture of the README: arm, error and effort of a report, as a WebP.

./pidtsm rollout --robot panda --params practical --duration 8 --set simulator.payload.mass=2.0 \
    --set simulator.payload.time=3.0 --out results/picture
./pidtsm shell -c "python scripts/picture.py results/picture docs/images/seven-joints.webp"
"""

import sys
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.devtools import Page, browser

_WIDTH, _HEIGHT = 1100, 800
"""Of the window, px."""
_RATE = 10.0
"""Pictures a second."""
_LARGEST = 1_000_000
"""Bytes of the file."""


def frames(page: Page, folder: Path) -> Iterator[Image.Image]:
    """The scene of an open report at each time of the picture."""
    box = page.evaluate(
        "(({left, top, width, height}) => ({x: left + scrollX, y: top + scrollY, width, height}))"
        "(document.querySelector('.scene').getBoundingClientRect())"
    )
    for index in range(int(page.evaluate("Number(document.getElementById('time').max)") * _RATE)):
        page.evaluate(
            f"document.getElementById('time').value = {index / _RATE};"
            "document.getElementById('time').dispatchEvent(new Event('input'));"
            "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"
        )
        page.screenshot(folder / "frame.png", **box)
        yield Image.open(BytesIO((folder / "frame.png").read_bytes())).convert("RGB")


def main(report: Path, picture: Path) -> None:
    """Write the picture of a report.

    Args:
        report: result folder with a report of a single run.
        picture: the file; an existing one is replaced.

    Raises:
        SystemExit: the picture is too large.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with browser(folder / "profile") as page:
            page.open((report / "report.html").resolve(), _WIDTH, _HEIGHT)
            first, *others = frames(page, folder)
    period = round(1e3 / _RATE)
    first.save(picture, save_all=True, append_images=others, duration=period, loop=0, quality=60, method=4)
    size = picture.stat().st_size
    print(f"{picture}: {1 + len(others)} pictures, {size / 1e6:.2f} MB")
    if size > _LARGEST:
        sys.exit(f"{picture} has more than {_LARGEST / 1e6:g} MB; shorten the run")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
