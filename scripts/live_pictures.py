"""The pictures of the live page in the documents: of the two-link arm and of the Panda.

./pidtsm shell -c "python scripts/live_pictures.py docs/images"
"""

import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.devtools import browser

_PROGRAM = Path(__file__).resolve().parents[1] / "pidtsm"
_PICTURES: dict[str, list[str]] = {"live-two-link.png": [], "live-panda.png": ["--robot", "panda"]}
_WIDTH, _HEIGHT = 1500, 900
"""Size of the window, px."""
_FOLLOWS = "(document.querySelector('#status')?.innerText ?? '').includes('Following')"
"""Whether the nodes have started and the arm follows."""
_STARTED_WITHIN = 120.0  # s
_FULL = 24.0
"""s until the curves fill their time window."""
_CLOSED = 1.0
"""s until a remark has vanished."""
_CLOSE = "document.querySelectorAll('.mantine-Notification-root button').forEach((each) => each.click())"
"""Closes the page's remark that this browser has no graphics card."""


def picture(file: Path, options: list[str]) -> None:
    """Write the picture of a live page with these options of ``./pidtsm live``."""
    live = subprocess.Popen([_PROGRAM, "live", *options], stdout=subprocess.PIPE, text=True)
    assert live.stdout is not None
    try:
        address = next(found[1] for line in live.stdout if (found := re.search(r"live page: (\S+)", line)))
        with tempfile.TemporaryDirectory() as profile, browser(Path(profile), in_3d=True) as page:
            page.open(address, _WIDTH, _HEIGHT)
            end = time.monotonic() + _STARTED_WITHIN
            while not page.evaluate(_FOLLOWS):
                assert time.monotonic() < end, "the arm does not follow"
                time.sleep(_CLOSED)
            time.sleep(_FULL)
            page.evaluate(_CLOSE)
            time.sleep(_CLOSED)
            page.screenshot(file)
    finally:
        live.send_signal(signal.SIGINT)
        live.wait()


if __name__ == "__main__":
    for name, options in _PICTURES.items():
        picture(Path(sys.argv[1]) / name, options)
