"""The page opens for itself, and from other machines with the token."""

import asyncio

import pytest

from pidtsm_experiments.live import gate
from pidtsm_experiments.live.gate import Gate, Places, hidden_address

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


@pytest.mark.parametrize(
    "fields",
    [
        OWN,
        OWN[:1],
        ("host: localhost:8080", "ORIGIN: http://localhost:8080"),
        ("Host: 127.0.0.1", "Origin: http://127.0.0.1"),
        ("Host: localhost", "Origin: http://localhost"),
        ("Host: localhost:80", "Origin: http://localhost"),
    ],
)
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
        ("", ("Host: 127.0.0.1", "Origin: http://127.0.0.1:8080")),
        ("", ("Host: elsewhere.example", "Origin: http://elsewhere.example")),
        ("", ("Host: elsewhere.example:8080", "Origin: http://elsewhere.example:8080")),
        ("", ()),
        (TOKEN, ("Host: 10.0.0.2:8080", "Origin: http://elsewhere.example")),
    ],
)
def test_another_page_in_the_same_browser_is_kept_out(token: str, fields: tuple[str, ...]) -> None:
    answer, received = asyncio.run(_sent(token, f"GET /{token} HTTP/1.1", *fields))
    assert answer.startswith(b"HTTP/1.1 403")
    assert not received


async def _locked_out(addresses: list[str], first: bytes) -> bytes:
    """What the owner gets while each of these addresses has opened a hundred connections and sent something."""

    async def page(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 200 OK\r\n\r\nthe page")
        writer.close()

    behind = await asyncio.start_server(page, hidden_address(), 0)
    host, port = behind.sockets[0].getsockname()
    front = await Gate(host, port, TOKEN).listen("127.0.0.1", 0)
    place = front.sockets[0].getsockname()
    idle = []
    for address in addresses * 100:
        _, writer = await asyncio.open_connection(*place, local_addr=(address, 0))
        writer.write(first)
        idle.append(writer)
    reader, writer = await asyncio.open_connection(*place)
    writer.write(f"GET /{TOKEN}/ HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    answer = await asyncio.wait_for(reader.read(), 10.0)
    for each in (writer, *idle):
        each.close()
    front.close()
    behind.close()
    return answer


@pytest.mark.parametrize("first", [b"", b"GET /", b"GET / HTTP/1.1\r\nHost: x\r\n"])
@pytest.mark.parametrize("addresses", [["127.0.0.1"], ["127.0.0.2"], [f"127.0.0.{i}" for i in range(2, 12)]], ids=len)
def test_who_has_no_token_locks_nobody_out(addresses: list[str], first: bytes) -> None:
    assert asyncio.run(_locked_out(addresses, first)).endswith(b"the page")


async def _first_line(line: bytes) -> bytes:
    """What a client gets that sends no more than the first line of its request."""
    front = await Gate("127.0.0.1", 1, TOKEN).listen("127.0.0.1", 0)
    reader, writer = await asyncio.open_connection(*front.sockets[0].getsockname())
    writer.write(line)
    answer = await asyncio.wait_for(reader.read(), 9.0)  # The rest of a request may take 10 s.
    writer.close()
    front.close()
    return answer


def test_a_request_without_the_token_is_refused_before_it_is_complete() -> None:
    assert asyncio.run(_first_line(b"GET /wrong HTTP/1.1\r\n")).startswith(b"HTTP/1.1 403")


def test_no_machine_takes_all_places_and_this_one_keeps_its_own() -> None:
    places = Places()
    assert sum(places.enter("10.0.0.1") for _ in range(100)) == gate._MOST_OF_ONE
    assert sum(places.enter(f"10.0.1.{i}") for i in range(100)) == gate._MOST - gate._MOST_OF_ONE
    assert not places.enter("10.0.0.2")
    assert sum(places.enter("127.0.0.1") for _ in range(100)) == gate._MOST
    places.leave("10.0.0.1")
    assert places.enter("10.0.0.2")
