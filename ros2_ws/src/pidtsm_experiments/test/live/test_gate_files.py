"""Files beside the page: those that are offered, for whoever may see the page."""

import asyncio
from pathlib import Path

import pytest

from pidtsm_experiments.live.gate import Gate


@pytest.mark.parametrize(
    ("path", "status"),
    [("/a-token/s/report.html?1", b"200 OK"), ("/s/report.html", b"403 Forbidden"), ("/a-token/s/gone.yaml", b"404")],
)
def test_a_file_is_given_to_whoever_has_the_token(tmp_path: Path, path: str, status: bytes) -> None:
    file = tmp_path / "report.html"
    file.write_text("größer", encoding="utf-8")

    async def asked() -> bytes:
        offered = {"s/report.html": file, "s/gone.yaml": tmp_path / "gone.yaml"}
        front = await Gate("127.0.0.1", 1, "a-token", offered).listen("127.0.0.1", 0)
        reader, writer = await asyncio.open_connection(*front.sockets[0].getsockname())
        writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        answer = await asyncio.wait_for(reader.read(), 10.0)
        writer.close()
        front.close()
        return answer

    answer = asyncio.run(asked())
    assert status in answer.splitlines()[0]
    assert answer.endswith("größer".encode()) == (status == b"200 OK")
