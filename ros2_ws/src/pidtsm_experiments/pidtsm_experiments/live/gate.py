"""The way to the page: for this machine's own pages, and from other machines for those who know the token."""

import asyncio
import secrets
from collections.abc import Mapping
from contextlib import suppress

_LONGEST_HEAD = 1 << 14  # bytes
_HEAD_WITHIN = 10.0  # s
_CHUNK = 1 << 16  # bytes
_MOST = 32
"""Connections at the same time; a browser has one or two."""
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_THIS_MACHINE = (b"127.0.0.1", b"localhost")


def hidden_address() -> str:
    """An address of this machine that no other page, open in the same browser, can guess."""
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


class Gate:
    """Passes connections on to the page, unless another page has made them.

    A browser lets every page open a WebSocket to any address, also to this machine, but names the page's origin. The
    request must come from the page itself; and with a token it must be for ``/TOKEN``, without one for this machine. A
    browser opens the WebSocket at the address of the page, which contains the token, too.
    """

    def __init__(self, host: str, port: int, token: str = "") -> None:
        """Args: host, port: where the page listens, on this machine; token: empty: only this machine is let in."""
        self._page, self._token = (host, port), token.encode()
        self._open = 0

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Accept connections.

        Raises:
            OSError: the address cannot be used.
        """
        return await asyncio.start_server(self._pass, host, port, limit=_LONGEST_HEAD)

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            request = await self._admitted(reader) if self._open <= _MOST else None
            if request is None:
                writer.write(_REFUSAL)
                await writer.drain()
                return
            theirs, ours = await asyncio.open_connection(*self._page)
            ours.write(request)
            await asyncio.gather(_copy(reader, ours), _copy(theirs, writer))
        except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError):
            pass  # Either side has gone, or what came is no request.
        finally:
            self._open -= 1
            writer.close()

    async def _admitted(self, reader: asyncio.StreamReader) -> bytes | None:
        """The head of the request as the page knows it; None: it is refused."""
        head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_WITHIN)
        line, _, rest = head.partition(b"\r\n")
        fields = (field.partition(b":") for field in rest.split(b"\r\n"))
        if not self._from_the_page({name.strip().lower(): value.strip() for name, _, value in fields}):
            return None
        known = self._without_token(line) if self._token else line
        return None if known is None else known + b"\r\n" + rest

    def _from_the_page(self, fields: Mapping[bytes, bytes]) -> bool:
        host = fields.get(b"host", b"")
        origin = fields.get(b"origin")
        if origin is not None and origin.partition(b"://")[2] != host:
            return False
        # The name of another site may be made to lead to this machine.
        return bool(self._token) or host.rpartition(b":")[0] in _THIS_MACHINE

    def _without_token(self, line: bytes) -> bytes | None:
        """A request line for ``/TOKEN`` as the page knows it; None: it lacks the token."""
        method, _, rest = line.partition(b" /")
        word, mark, version = rest.partition(b" ")
        path, question, query = word.partition(b"?")
        given, _, below = path.partition(b"/")
        if not mark or not secrets.compare_digest(given, self._token):
            return None
        return method + b" /" + below + question + query + b" " + version


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass on what comes, until one side has gone."""
    with suppress(OSError):
        while data := await reader.read(_CHUNK):
            writer.write(data)
            await writer.drain()
    with suppress(OSError, RuntimeError):
        writer.close()
