"""Headless Chromium over its DevTools pipe: what a page logs, requests from the network, and shows."""

import base64
import fcntl
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_TIMEOUT = 120.0  # s; a browser that renders 3-D in software is slow where other tests run, too
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-pipe",
)


_WITHOUT_3D = ("--disable-gpu",)
_WITH_3D = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_FEW_FRAMES = """
const request = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = callback => setTimeout(() => request(callback), 400);
window.cancelAnimationFrame = clearTimeout;
"""
"""Makes a page draw about twice a second: one picture takes a software renderer up to a fifth of a second."""


class Page:
    """One page of the browser.

    Attributes:
        events: everything the browser reported, in order.
    """

    def __init__(self, commands: int, answers: int, script: str) -> None:
        """Args: script: run in each document before its own."""
        self.events: list[dict[str, Any]] = []
        self._commands, self._answers = commands, answers
        self._rest, self._number, self._session = b"", 0, None
        os.set_blocking(answers, False)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Page.addScriptToEvaluateOnNewDocument", source=script)

    def call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + _TIMEOUT
        while time.monotonic() < deadline:
            for answer in self._read():
                if answer.get("id") == self._number:
                    assert "error" not in answer, answer["error"]
                    return answer["result"]
                self.events.append(answer)
        raise TimeoutError(method)

    def _read(self) -> list[dict[str, Any]]:
        try:
            data = os.read(self._answers, 1 << 20)
        except BlockingIOError:
            time.sleep(0.005)
            return []
        assert data, "the browser has ended"
        *messages, self._rest = (self._rest + data).split(b"\0")
        return [json.loads(message) for message in messages]

    def open(self, place: Path | str, width: int = 1200, height: int = 900) -> None:
        """Open a file or an address."""
        self.resize(width, height)
        self.events.clear()
        self.call("Page.navigate", url=place if isinstance(place, str) else place.as_uri())
        self.wait("document.readyState === 'complete'")

    def resize(self, width: int, height: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )

    def evaluate(self, script: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str) -> None:
        deadline = time.monotonic() + _TIMEOUT
        while not self.evaluate(condition):
            assert time.monotonic() < deadline, condition
            time.sleep(0.02)

    def focus(self, selector: str) -> None:
        self.evaluate(f"document.querySelector({selector!r}).focus()")

    def key(self, key: str, code: int, text: str = "") -> None:
        """Press a key as a user does."""
        common = {"key": key, "code": "Space" if key == " " else key, "windowsVirtualKeyCode": code}
        self.call("Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", text=text, **common)
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def click(self, selector: str) -> None:
        """Press the mouse in the middle of an element."""
        self.drag(selector, 0, 0)

    def drag(self, selector: str, right: int, down: int) -> None:
        """Press the mouse in the middle of an element, move it by these pixels, and release it."""
        script = f"""(() => {{
            const element = document.querySelector({selector!r});
            element.scrollIntoView({{block: "center", behavior: "instant"}});
            const box = element.getBoundingClientRect();
            return [box.left + box.width / 2, box.top + box.height / 2];
        }})()"""
        x, y = self.evaluate(script)
        for kind, far in (("mouseMoved", 0), ("mousePressed", 0), ("mouseMoved", 1), ("mouseReleased", 1)):
            place = {"x": x + far * right, "y": y + far * down}
            self.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **place)

    def screenshot(self, path: Path, **clip: float) -> None:
        """Save a picture of the page, or of a part of it: x, y, width and height in pixels."""
        part = {"clip": clip | {"scale": 1}} if clip else {}
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png", **part)["data"]))

    @property
    def complaints(self) -> list[str]:
        """Errors, warnings and exceptions of the page."""
        found = []
        for event in self.events:
            parameters = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                found.append(str(parameters["exceptionDetails"]))
            if event.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning"):
                found.append(str(parameters["args"]))
            if event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
                found.append(parameters["entry"]["text"])
        return found

    @property
    def requests(self) -> list[str]:
        """Addresses that the page requested."""
        requested = [event["params"] for event in self.events if event.get("method") == "Network.requestWillBeSent"]
        return [request["request"]["url"] for request in requested]


@contextmanager
def browser(profile: Path, in_3d: bool = False) -> Iterator[Page]:
    """A browser with one empty page.

    Args:
        profile: folder for what it keeps.
        in_3d: whether it renders WebGL, in software.
    """
    options = (*_OPTIONS, *(_WITH_3D if in_3d else _WITHOUT_3D))
    assert CHROMIUM
    theirs_in, commands = os.pipe()
    answers, theirs_out = os.pipe()

    def place() -> None:  # where the browser reads and writes: 3 and 4
        copies = [fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (theirs_in, theirs_out)]
        for copy, fd in zip(copies, (3, 4), strict=True):
            os.dup2(copy, fd)

    with (profile.parent / "chromium.log").open("wb") as log:
        process = subprocess.Popen(
            [CHROMIUM, *options, f"--user-data-dir={profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            preexec_fn=place,
            pass_fds=(3, 4),
        )
        os.close(theirs_in)
        os.close(theirs_out)
        try:
            yield Page(commands, answers, _FEW_FRAMES if in_3d else "")
        finally:
            os.close(commands)
            os.close(answers)
            process.terminate()
            process.wait(_TIMEOUT)
