"""From other machines, only the token opens the page."""

import asyncio

import pytest

from pidtsm_experiments.live.gate import Gate


async def _ask(request: str) -> tuple[bytes, list[bytes]]:
    """What a client gets that sends this request line to a gate, and what the page behind it has received."""
    received = []

    async def page(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        received.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b"HTTP/1.1 200 OK\r\n\r\nthe page")
        writer.close()

    behind = await asyncio.start_server(page, "127.0.0.1", 0)
    gate = Gate(behind.sockets[0].getsockname()[1])
    front = await gate.listen("127.0.0.1", 0)
    reader, writer = await asyncio.open_connection(*front.sockets[0].getsockname())
    writer.write(f"{request.format(token=gate.token)}\r\nHost: x\r\n\r\n".encode())
    answer = await asyncio.wait_for(reader.read(), 10.0)
    writer.close()
    front.close()
    behind.close()
    return answer, received


@pytest.mark.parametrize(
    ("asked", "passed"),
    [("/{token}/", "/"), ("/{token}", "/"), ("/{token}/x.png?y=1", "/x.png?y=1"), ("/{token}?darkMode", "/?darkMode")],
)
def test_the_token_opens_the_page(asked: str, passed: str) -> None:
    answer, received = asyncio.run(_ask(f"GET {asked} HTTP/1.1"))
    assert answer.endswith(b"the page")
    assert received[0].splitlines()[:2] == [f"GET {passed} HTTP/1.1".encode(), b"Host: x"]


@pytest.mark.parametrize(
    "asked", ["GET / HTTP/1.1", "GET /{token}x/ HTTP/1.1", "GET /x/{token} HTTP/1.1", "nonsense", ""]
)
def test_nothing_else_does(asked: str) -> None:
    answer, received = asyncio.run(_ask(asked))
    assert answer.startswith(b"HTTP/1.1 403")
    assert not received
