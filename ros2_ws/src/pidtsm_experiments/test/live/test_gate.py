"""The page opens for itself, and from other machines with the token."""

import asyncio

import pytest

from pidtsm_experiments.live.gate import Gate, hidden_address

TOKEN = "a-token"
OWN = ("Host: 127.0.0.1:8080", "Origin: http://127.0.0.1:8080")


async def _sent(token: str, *lines: str) -> tuple[bytes, list[bytes]]:
    """What a client gets that sends this request to a gate, and what the page behind it has received."""
    received = []

    async def page(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        received.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b"HTTP/1.1 200 OK\r\n\r\nthe page")
        writer.close()

    behind = await asyncio.start_server(page, hidden_address(), 0)
    host, port = behind.sockets[0].getsockname()
    gate = Gate(host, port, token)
    front = await gate.listen("127.0.0.1", 0)
    reader, writer = await asyncio.open_connection(*front.sockets[0].getsockname())
    writer.write("".join(f"{line}\r\n" for line in (*lines, "")).encode())
    answer = await asyncio.wait_for(reader.read(), 10.0)
    writer.close()
    front.close()
    behind.close()
    return answer, received


@pytest.mark.parametrize(
    ("path", "passed"),
    [(f"/{TOKEN}/", "/"), (f"/{TOKEN}", "/"), (f"/{TOKEN}/x.png?y=1", "/x.png?y=1"), (f"/{TOKEN}?dark", "/?dark")],
)
def test_the_token_opens_the_page(path: str, passed: str) -> None:
    answer, received = asyncio.run(_sent(TOKEN, f"GET {path} HTTP/1.1", "Host: x", "Origin: http://x"))
    assert answer.endswith(b"the page")
    assert received[0].splitlines()[:2] == [f"GET {passed} HTTP/1.1".encode(), b"Host: x"]


@pytest.mark.parametrize("line", ["GET / HTTP/1.1", f"GET /{TOKEN}x/ HTTP/1.1", f"GET /x/{TOKEN} HTTP/1.1", "nonsense"])
def test_nothing_else_does(line: str) -> None:
    answer, received = asyncio.run(_sent(TOKEN, line, *OWN))
    assert answer.startswith(b"HTTP/1.1 403")
    assert not received


@pytest.mark.parametrize("fields", [OWN, OWN[:1], ("host: localhost:8080", "ORIGIN: http://localhost:8080")])
def test_this_machine_needs_no_token(fields: tuple[str, ...]) -> None:
    answer, received = asyncio.run(_sent("", "GET /?x HTTP/1.1", *fields))
    assert answer.endswith(b"the page")
    assert received[0].splitlines()[1] == fields[0].encode()


@pytest.mark.parametrize(
    ("token", "fields"),
    [
        ("", ("Host: 127.0.0.1:8080", "Origin: http://elsewhere.example")),
        ("", ("Host: 127.0.0.1:8080", "Origin: http://127.0.0.1:9090")),
        ("", ("Host: 127.0.0.1:8080", "Origin: null")),
        ("", ("Host: elsewhere.example:8080", "Origin: http://elsewhere.example:8080")),
        ("", ()),
        (TOKEN, ("Host: 10.0.0.2:8080", "Origin: http://elsewhere.example")),
    ],
)
def test_another_page_in_the_same_browser_is_kept_out(token: str, fields: tuple[str, ...]) -> None:
    answer, received = asyncio.run(_sent(token, f"GET /{token} HTTP/1.1", *fields))
    assert answer.startswith(b"HTTP/1.1 403")
    assert not received
