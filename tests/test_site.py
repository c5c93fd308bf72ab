"""The site of the documents: built without a warning, and read in a real browser, which asks no other machine."""

import functools
import http.server
import sys
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from support.devtools import CHROMIUM, Page, browser

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from docs import build  # noqa: E402

SEARCHES = {
    "change payload while it runs": "launch-and-containers",
    "which joint rings in my bag": "diagnose",
    "reset a fault": "faults nodes",
    "install without internet": "distribution",
    "move the arm by hand": "freedrive",
    "torque chatters with a real encoder": "tuning",
    "limit the speed of the tool": "poses",
    "record my own robot": "record-and-analyse",
    "export to CSV": "record-and-analyse",
    "use MoveIt": "moveit",
    "law.upsilon": "reference tuning",
    "write my own control law": "own-law",
    "use the URDF of my robot": "own-robot",
    "driver already compensates gravity": "own-robot ros2-control",
    "joints in another order": "faults own-robot",
    "set torque limits": "own-robot commissioning",
    "arm falls when the controller is killed": "commissioning faults ros2-control",
    "robot on another computer": "security",
    "real-time priority": "timing",
    "estimate the mass of the payload": "identify",
    "compare two runs": "record-and-analyse",
    "joystick teleoperation": "streams poses",
    "arm with a gripper": "own-robot",
    "docker container": "launch-and-containers",
    "soft contact stiffness": "compliance",
    "simulate friction": "hardware",
    "drives are late": "adaptation",
    "python rollout example": "api index",
    "two arms in namespaces": "launch-and-containers",
    "add a new robot in closed form": "new-members",
    "emergency stop": "commissioning",
    "mass in URDF is wrong": "identify",
    "plot error of a run": "record-and-analyse running",
    "change a gain while it runs": "quick-start nodes",
    "save learnt gains": "live adaptation",
    "run faster than real time": "running",
    "what is lockstep": "glossary running",
    "follow a CSV trajectory": "trajectories",
    "inverse kinematics line": "poses",
    "cite": "index",
    "install without network": "distribution",
    "own law": "own-law",
    "add a surface": "new-members",
    "URDF friction damping": "own-robot",
    "reset fault": "faults",
    "brakes": "commissioning",
    "record bag": "record-and-analyse",
    "LaTeX table": "record-and-analyse",
    "CSV export": "record-and-analyse",
    "MoveIt": "moveit",
    "freedrive": "freedrive",
    "identify payload": "identify",
    "encoder bits": "hardware",
    "rate limit": "architecture",
    "lockstep": "glossary running timing",
    "rollout batch": "api running",
    "DDS-Security": "security",
    "verify gains against the theorem": "theory",
    "score of a controller": "score",
    "install": "index distribution",
    "PIDDTSM equations": "concepts",
    "joint limits": "own-robot trajectories barrier limits",
    "wrench at the tool without a force sensor": "poses",
    "delay of the drives": "adaptation",
    "leave the limits barrier": "barrier",
    "what is sigma": "glossary concepts",
    "two-arm robot": "own-robot",
    "notebook": "examples/index index",
}
"""What a reader looks for, in the words of somebody who knows none of these pages, and pages with the answer."""
FIRST = 4
"""One of them is among so many that are found first, which is what the list shows without scrolling."""
FIELD = "document.querySelector('.md-search__input')"
FOUND = "[...document.querySelectorAll('.md-search-result__item')]"


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


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One browser for all searches."""
    with browser(tmp_path_factory.mktemp("profile")) as page:
        yield page


def write(reader: Page, words: str) -> None:
    """Replace what is in the field of the search."""
    reader.evaluate(f"(field => {{ field.focus(); field.select(); }})({FIELD})")
    reader.call("Input.insertText", text=words)
    reader.evaluate(f"{FIELD}.dispatchEvent(new Event('keyup', {{bubbles: true}}))")


def judge_search(address: str, reader: Page, names: str) -> None:
    """Wait for what is found, and check that one of these pages is among the first, and nothing is wrong."""
    reader.wait(f"{FOUND}.length > 0")
    found = reader.evaluate(f"{FOUND}.slice(0, {FIRST}).map(item => item.querySelector('a').pathname)")
    assert {f"/{name}.html" for name in names.split()} & set(found), found
    assert not reader.complaints
    assert all(request.startswith((address, "data:", "blob:")) for request in reader.requests)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
@pytest.mark.parametrize(("words", "names"), SEARCHES.items())
def test_a_search_finds_the_page_with_the_answer(address: str, reader: Page, words: str, names: str) -> None:
    """All on one page: loading it and its index takes a second, a search takes none."""
    if reader.evaluate("location.pathname") != "/topics.html":
        reader.open(f"{address}/topics.html")
    write(reader, "")
    reader.wait(f"{FOUND}.length === 0")
    write(reader, words)
    judge_search(address, reader, names)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
def test_an_address_can_have_a_search(address: str, reader: Page) -> None:
    words, names = next(iter(SEARCHES.items()))
    reader.open(f"{address}/topics.html?q={quote(words)}")
    judge_search(address, reader, names)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
def test_a_reader_finds_equations_diagrams_and_pictures(address: str, reader: Page) -> None:
    reader.open(f"{address}/concepts.html")
    assert reader.evaluate("document.querySelectorAll('math').length") > 20
    assert reader.evaluate("document.querySelector('math').getBoundingClientRect().width") > 5
    assert "$" not in reader.evaluate("document.querySelector('article').innerText")
    asked = list(reader.requests)
    reader.open(f"{address}/architecture.html")
    reader.wait("[...document.querySelectorAll('div.mermaid')].some(drawn => drawn.offsetHeight > 100)")
    reader.open(f"{address}/examples/index.html")
    assert reader.evaluate("[...document.images].filter(i => i.complete && i.naturalWidth > 300).length") >= 3
    assert not reader.complaints
    assert all(request.startswith((address, "data:", "blob:")) for request in [*asked, *reader.requests])


def test_notebooks_are_shown_with_what_they_print_and_draw(address: str) -> None:
    for name, printed in (("colab", "super_twisting [0."), ("own_law", "failed: {}"), ("payload_of_an_arm", "kg: [")):
        with urllib.request.urlopen(f"{address}/examples/{name}.html") as page:
            text = page.read().decode()
        assert f"{name}_files/" in text, "no picture"
        assert printed in text
