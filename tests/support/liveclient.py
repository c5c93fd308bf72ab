"""A live page without a browser: the messages that a browser would send, and what it would show."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from support.livepage import until

_HEADER = 16  # bytes: the sizes of what follows, decompressed and compressed
_CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 10,
    "image_width": 10,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


class LiveClient:
    """One connection to a page.

    Attributes:
        elements: by id, the message that has created each element of the page, with its present value and content.
        scene: by name, the last properties of each part of the scene that has changed.
        received: number of bytes.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self.scene: dict[str, dict[str, Any]] = {}
        self.elements: dict[str, dict[str, Any]] = {}
        self.received = 0
        self._connection = connection
        self.send(_CAMERA)  # Without it, a client does not count as connected.
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def send(self, message: dict[str, Any]) -> None:
        """Send any message."""
        self._connection.send(msgspec.msgpack.encode(message))

    def _read(self) -> None:
        decompressor = zstandard.ZstdDecompressor()
        try:
            while isinstance(data := self._connection.recv(), bytes):
                self.received += len(data)
                size, packed = (int.from_bytes(data[i : i + 8], "little") for i in (0, 8))
                inner = decompressor.decompress(data[_HEADER : _HEADER + packed], max_output_size=size)
                for message in msgspec.msgpack.decode(inner)["messages"]:
                    self._take(message)
        except ConnectionClosed:
            pass

    def _take(self, message: dict[str, Any]) -> None:
        kind, uuid = message["type"], message.get("uuid")
        if kind == "GuiUpdateMessage":
            element = self.elements.get(message["uuid"], {})
            for name, value in message["updates"].items():
                (element if name in element else element.get("props", {}))[name] = value
        elif kind == "SceneNodeUpdateMessage":
            self.scene.setdefault(message["name"], {}).update(message["updates"])
        elif kind == "SetSceneNodeVisibilityMessage":
            self.scene.setdefault(message["name"], {})["visible"] = message["visible"]
        elif kind == "GuiRemoveMessage":
            self.elements.pop(message["uuid"], None)
        elif kind.startswith("Gui") and uuid is not None and "props" in message:
            self.elements[uuid] = message

    def find(self, label: str) -> dict[str, Any]:
        """The first element with this label; a page gets its elements one after the other."""

        def found() -> list[dict[str, Any]]:
            return [e for e in tuple(self.elements.values()) if e["props"].get("label") == label]

        first: dict[str, Any] = until(found, f"the element {label}")[0]
        return first

    def shown(self, word: str) -> str:
        """The HTML element that contains a word; empty: there is none."""
        contents = (str(e["props"].get("content", "")) for e in tuple(self.elements.values()))
        return next((content for content in contents if word in content), "")

    def enter(self, label: str, value: Any) -> None:
        """Give an element a value."""
        self.send({"type": "GuiUpdateMessage", "uuid": self.find(label)["uuid"], "updates": {"value": value}})

    def press(self, label: str) -> None:
        """Press a button."""
        self.enter(label, value=True)

    def submit(self, form: str) -> None:
        """Press Enter in a form."""
        self.send({"type": "GuiFormSubmitMessage", "uuid": self.find(form)["uuid"]})


@contextmanager
def live_client(address: str) -> Iterator[LiveClient]:
    """Connect to the page at this address (http)."""
    protocols = [Subprotocol(f"viser-v{viser.__version__}")]
    place = address.replace("http://", "ws://")
    with connect(place, subprotocols=protocols, max_size=None, compression=None) as connection:
        assert isinstance(connection, ClientConnection)
        yield LiveClient(connection)
