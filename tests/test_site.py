"""The site of the documents: built without a warning, and read in a real browser, which asks no other machine."""

import functools
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.devtools import CHROMIUM, browser

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from docs import build  # noqa: E402

SEARCHES = {
    "payload": "payload",
    "freedrive": "freedrive",
    "law.upsilon": "reference",
    "recording": "record",
}
"""What a reader looks for, and a word in the address of a page among the first answers."""


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
        for words, word in SEARCHES.items():
            page.open(f"{address}/index.html")
            page.evaluate("document.querySelector('label[for=__search]').click()")
            page.focus("input[name=query]")
            page.call("Input.insertText", text=words)
            page.wait("document.querySelectorAll('.md-search-result__item a').length > 0")
            found = page.evaluate("[...document.querySelectorAll('.md-search-result__item a')].map(a => a.href)")
            assert any(word in place for place in found[:8]), (words, found[:8])
            asked += page.requests
        page.open(f"{address}/architecture.html")
        page.wait("[...document.querySelectorAll('div.mermaid')].some(drawn => drawn.offsetHeight > 100)")
        page.open(f"{address}/examples/index.html")
        assert page.evaluate("[...document.images].filter(i => i.complete && i.naturalWidth > 300).length") >= 3
        assert not page.complaints
        assert all(request.startswith((address, "data:", "blob:")) for request in [*asked, *page.requests])
