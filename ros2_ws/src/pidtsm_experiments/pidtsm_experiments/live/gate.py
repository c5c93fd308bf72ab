"""The way to the page from other machines, only for those who know the token in its address."""

import asyncio
import secrets
from contextlib import suppress

_LONGEST_LINE = 4096  # bytes
_LINE_WITHIN = 10.0  # s
_CHUNK = 1 << 16  # bytes
_MOST = 32
"""Connections at the same time; a browser has one or two."""
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class Gate:
    """Passes connections on to the page if their first request is for ``/TOKEN``.

    The page itself listens on this machine only. A browser opens its WebSocket at the address of the page, so that has
    the token, too.

    Attributes:
        token: the token.
    """

    def __init__(self, port: int) -> None:
        """Args: port: of the page, on this machine."""
        self.token = secrets.token_urlsafe(16)
        self._port = port
        self._open = 0

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Accept connections.

        Raises:
            OSError: the address cannot be used.
        """
        return await asyncio.start_server(self._pass, host, port, limit=_LONGEST_LINE)

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            request = await self._admitted(reader) if self._open <= _MOST else None
            if request is None:
                writer.write(_REFUSAL)
                await writer.drain()
                return
            theirs, ours = await asyncio.open_connection("127.0.0.1", self._port)
            ours.write(request)
            await asyncio.gather(_copy(reader, ours), _copy(theirs, writer))
        except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.TimeoutError):
            pass  # Either side has gone, or what came is no request.
        finally:
            self._open -= 1
            writer.close()

    async def _admitted(self, reader: asyncio.StreamReader) -> bytes | None:
        """The first line of the request as the page knows it; None: it lacks the token."""
        line = await asyncio.wait_for(reader.readline(), _LINE_WITHIN)
        method, _, rest = line.partition(b" /")
        word, mark, version = rest.partition(b" ")
        path, question, query = word.partition(b"?")
        given, _, below = path.partition(b"/")
        if not mark or not secrets.compare_digest(given, self.token.encode()):
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
