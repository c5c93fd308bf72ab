"""The way to the page: for this machine's own pages, and from other machines for those who know the token."""

import asyncio
import secrets
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

_LONGEST_HEAD = 1 << 14  # bytes
_HEAD_WITHIN = 10.0  # s
_CHUNK = 1 << 16  # bytes
_WAITING, _WAITING_OF_ONE = 64, 8
"""Connections that have not sent their request yet: of all addresses, and of one."""
_MOST, _MOST_OF_ONE = 32, 16
"""Connections with the page: of other machines, and of one of them; this machine has as many for itself."""
_PORT = b":80"
"""The port that a browser leaves out."""
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_MISSING = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_KINDS = {".html": b"text/html"}
"""Media types by suffix; everything else is shown as text."""
_THIS_MACHINE = (b"127.0.0.1", b"localhost")


def hidden_address() -> str:
    """An address of this machine that no other page, open in the same browser, can guess."""
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


class Places:
    """Connections with the page, so that nobody takes all of them."""

    def __init__(self) -> None:
        self._taken: Counter[str] = Counter()

    def enter(self, address: str) -> bool:
        """Take a place for a connection from an address; False if there is none."""
        if is_here(address):
            taken = sum(count for each, count in self._taken.items() if is_here(each))
        else:
            taken = sum(count for each, count in self._taken.items() if not is_here(each))
            taken = max(taken, self._taken[address] + _MOST - _MOST_OF_ONE)
        if taken >= _MOST:
            return False
        self._taken[address] += 1
        return True

    def leave(self, address: str) -> None:
        """Give a place back."""
        self._taken[address] -= 1


class Gate:
    """Passes connections on to the page, unless another page has made them.

    A browser lets every page open a WebSocket to any address, also to this machine, but names the page's origin. The
    request must come from the page itself; and with a token it must be for ``/TOKEN``, without one for this machine. A
    browser opens the WebSocket at the address of the page, which contains the token, too.
    """

    def __init__(self, host: str, port: int, token: str = "", offered: Mapping[str, Path] | None = None) -> None:
        """Nobody is let in yet.

        Args:
            host: where the page listens, an address of this machine.
            port: likewise.
            token: empty: only this machine is let in.
            offered: files beside the page, by their paths below its address; they may come and go.
        """
        self._page, self._token = (host, port), token.encode()
        self._offered = {} if offered is None else offered
        self._places = Places()
        self._waiting: dict[asyncio.StreamWriter, str] = {}

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Accept connections.

        Raises:
            OSError: the address cannot be used.
        """
        return await asyncio.start_server(self._pass, host, port, limit=_LONGEST_HEAD)

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        address = str(writer.get_extra_info("peername")[0])
        has_place = False
        try:
            request = await self._awaited(reader, writer, address)
            has_place = request is not None and self._places.enter(address)
            if request is None or not has_place:
                writer.write(_REFUSAL)
                await writer.drain()
                return
            if (file := self._offered.get(_path(request))) is not None:
                writer.write(_answer(file))
                await writer.drain()
                return
            theirs, ours = await asyncio.open_connection(*self._page)
            ours.write(request)
            await asyncio.gather(_copy(reader, ours), _copy(theirs, writer))
        except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError):
            pass  # Either side has gone, or what came is no request.
        finally:
            if has_place:
                self._places.leave(address)
            writer.close()

    async def _awaited(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, address: str) -> bytes | None:
        """The request that comes within some time, see `_admitted`.

        Whoever has no token can only wait here, and not for long: a newcomer takes the place of the one that has waited
        longest, of the address with most of them.
        """
        self._waiting[writer] = address
        counts = Counter(self._waiting.values())
        if len(self._waiting) > _WAITING or counts[address] > _WAITING_OF_ONE:
            most = max(counts, key=counts.__getitem__)
            oldest = next(each for each, of in self._waiting.items() if of == most)
            del self._waiting[oldest]
            oldest.transport.abort()
        try:
            return await asyncio.wait_for(self._admitted(reader), _HEAD_WITHIN)
        finally:
            self._waiting.pop(writer, None)

    async def _admitted(self, reader: asyncio.StreamReader) -> bytes | None:
        """The head of the request as the page knows it; None: it is refused, without a token before it is complete."""
        line = (await reader.readuntil(b"\r\n")).removesuffix(b"\r\n")
        known = self._without_token(line) if self._token else line
        if known is None:
            return None
        rest = b""
        while not rest.endswith(b"\r\n\r\n") and rest != b"\r\n":
            rest += await reader.readuntil(b"\r\n")
            if len(rest) > _LONGEST_HEAD:
                return None
        fields = (field.partition(b":") for field in rest.split(b"\r\n"))
        if not self._from_the_page({name.strip().lower(): value.strip() for name, _, value in fields}):
            return None
        return known + b"\r\n" + rest

    def _from_the_page(self, fields: Mapping[bytes, bytes]) -> bool:
        host = fields.get(b"host", b"").removesuffix(_PORT)
        origin = fields.get(b"origin")
        if origin is not None and origin.partition(b"://")[2].removesuffix(_PORT) != host:
            return False
        # The name of another site may be made to lead to this machine.
        return bool(self._token) or host.partition(b":")[0] in _THIS_MACHINE

    def _without_token(self, line: bytes) -> bytes | None:
        """A request line for ``/TOKEN`` as the page knows it; None: it lacks the token."""
        method, _, rest = line.partition(b" /")
        word, mark, version = rest.partition(b" ")
        path, question, query = word.partition(b"?")
        given, _, below = path.partition(b"/")
        if not mark or not secrets.compare_digest(given, self._token):
            return None
        return method + b" /" + below + question + query + b" " + version


def _path(request: bytes) -> str:
    """What a request is for, below the address of the page, without the query."""
    words = request.split(b" ", 2)
    return words[1].partition(b"?")[0].removeprefix(b"/").decode(errors="replace") if words[0] == b"GET" else ""


def _answer(file: Path) -> bytes:
    """A file as an answer; it is small."""
    try:
        content = file.read_bytes()
    except OSError:
        return _MISSING
    kind = _KINDS.get(file.suffix, b"text/plain")
    head = b"HTTP/1.1 200 OK\r\nContent-Type: %b; charset=utf-8\r\nContent-Length: %d\r\n" % (kind, len(content))
    return head + b"Cache-Control: no-store\r\nConnection: close\r\n\r\n" + content


def is_here(address: str) -> bool:
    """Whether an IP address is one of this machine alone."""
    return ip_address(address.partition("%")[0]).is_loopback


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass on what comes, until one side has gone."""
    with suppress(OSError):
        while data := await reader.read(_CHUNK):
            writer.write(data)
            await writer.drain()
    with suppress(OSError, RuntimeError):
        writer.close()
