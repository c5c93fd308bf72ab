"""Makes the pictures of the live page in docs/images: python scripts/screenshots.py [ARM ...]."""

import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests"))

from support.devtools import browser  # noqa: E402  In the folder of the tests.
from support.livepage import LivePage, live_process, until  # noqa: E402

ARMS = ("two_link", "panda")
WIDTH, HEIGHT = 1500, 900  # pixels
WATCHED = 24.0
"""Time before the picture, s: the curves are full."""
_CLOSE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())"


def picture(arm: str, file: Path) -> None:
    """Watch an arm, and take a picture of the page."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with live_process(folder, "--robot", arm) as system, browser(folder / "profile", in_3d=True) as page:
            shown = LivePage(page, system)
            page.resize(WIDTH, HEIGHT)
            until(lambda: "Following" in shown.text("#status"), "the arm follows")
            time.sleep(WATCHED)
            page.evaluate(_CLOSE)
            time.sleep(1.0)
            page.screenshot(file)


if __name__ == "__main__":
    for each in sys.argv[1:] or ARMS:
        picture(each, ROOT / "docs" / "images" / f"live-{each.replace('_', '-')}.png")
