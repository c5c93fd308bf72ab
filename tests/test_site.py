"""The site of the documents: built without a warning, and read in a real browser, which asks no other machine."""

import functools
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from support.devtools import CHROMIUM, browser

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from docs import build  # noqa: E402

SEARCHES = {
    "change payload while it runs": "launch-and-containers",
    "install without network": "distribution",
    "own law": "own-law",
    "add a surface": "new-members",
    "URDF friction damping": "own-robot",
    "reset fault": "faults",
    "brakes": "commissioning",
    "record bag": "record-and-analyse",
    "compare runs": "record-and-analyse",
    "LaTeX table": "record-and-analyse",
    "CSV export": "record-and-analyse",
    "MoveIt": "moveit",
    "freedrive": "freedrive",
    "identify payload": "identify",
    "encoder bits": "hardware",
    "rate limit": "architecture",
    "lockstep": "glossary",
    "law.upsilon": "reference",
    "rollout batch": "api",
    "DDS-Security": "security",
}
"""What a reader looks for, and a page that is among the first ten that are found."""
FOUND = "[...document.querySelectorAll('.md-search-result__item > a')]"


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The site, built and served."""
    folder = tmp_path_factory.mktemp("site")
    build(folder)
    handler = functools.partial(Handler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
def test_a_reader_finds_pages_equations_diagrams_and_pictures(address: str, tmp_path: Path) -> None:
    with browser(tmp_path / "profile") as page:
        page.open(f"{address}/concepts.html")
        assert page.evaluate("document.querySelectorAll('math').length") > 20
        assert page.evaluate("document.querySelector('math').getBoundingClientRect().width") > 5
        assert "$" not in page.evaluate("document.querySelector('article').innerText")
        asked = list(page.requests)
        for words, name in SEARCHES.items():
            page.open(f"{address}/topics.html?q={quote(words)}")
            page.wait(f"{FOUND}.length > 0")
            found = page.evaluate(f"{FOUND}.map(link => link.pathname)")
            assert f"/{name}.html" in list(dict.fromkeys(found))[:10], (words, found)
            asked += page.requests
        page.open(f"{address}/architecture.html")
        page.wait("[...document.querySelectorAll('div.mermaid')].some(drawn => drawn.offsetHeight > 100)")
        page.open(f"{address}/examples/index.html")
        assert page.evaluate("[...document.images].filter(i => i.complete && i.naturalWidth > 300).length") >= 3
        assert not page.complaints
        assert all(request.startswith((address, "data:", "blob:")) for request in [*asked, *page.requests])
