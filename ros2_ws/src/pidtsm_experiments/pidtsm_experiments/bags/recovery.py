"""Recovers an unfinished bag, whose recorder was killed or whose disk was full."""

import shutil
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, IndexType, Writer

_HEAD = struct.Struct("<BQ")  # opcode and length, before the content of a record
_DATA = {
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
}
"""Records of the data section; those after it are written again."""


@dataclass(frozen=True)
class Readable:
    """A bag in a form that rosbags can read.

    Attributes:
        files: its folder or its files; empty if nothing can be read.
        flaws: signs that the bag was not finished; empty if it was finished.
    """

    files: list[Path]
    flaws: list[str]


@contextmanager
def readable(path: Path) -> Iterator[Readable]:
    """Yield a bag in a readable form, without changing the bag itself.

    An incomplete MCAP file is copied to a temporary folder up to its last complete record, and completed there as the
    format requires.

    Args:
        path: folder of a bag, or one file.
    """
    files = sorted([*path.glob("*.mcap"), *path.glob("*.db3")]) if path.is_dir() else [path]
    cut = [file for file in files if file.suffix == ".mcap" and file.is_file() and not _is_whole(file)]
    flaws = ["no metadata.yaml"] if path.is_dir() and files and not (path / "metadata.yaml").exists() else []
    if not (cut or flaws):
        yield Readable([path], [])
        return
    with TemporaryDirectory(prefix="pidtsm-") as folder:
        whole = []
        for file in files:
            if file not in cut:
                whole.append(file)
                continue
            end = _end_of_records(file)
            flaws.append(f"{file.name} has no end: {end} of its {file.stat().st_size} bytes are complete records")
            if end:
                whole.append(_ended(file, end, Path(folder)))
        yield Readable(whole, flaws)


def stored_metadata(file: Path, key: str) -> Mapping[str, str]:
    """The MCAP metadata record with this name at the beginning of a file; empty if there is none."""
    with file.open("rb") as stream, suppress(McapError, struct.error, ValueError):
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Metadata) and record.name == key:
                return record.metadata
            if isinstance(record, Chunk):
                break
    return {}


def _is_whole(file: Path) -> bool:
    with file.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC


def _end_of_records(file: Path) -> int:
    """Bytes of a file up to the end of its last complete data record; 0 if there is none."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            return 0
        end = begin = stream.tell()
        while len(head := stream.read(_HEAD.size)) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            after = end + _HEAD.size + length
            if opcode not in _DATA or after > size:
                break
            end = stream.seek(after)
    return end if end > begin else 0


def _ended(file: Path, end: int, folder: Path) -> Path:
    """Copy the first `end` bytes of an MCAP file to a folder, and add an end without an index."""
    copy = folder / file.name
    shutil.copyfile(file, copy)
    with copy.open("r+b") as stream:
        stream.truncate(end)
        stream.seek(end)
        Writer(
            stream,
            index_types=IndexType.NONE,
            repeat_channels=False,
            repeat_schemas=False,
            use_statistics=False,
            use_summary_offsets=False,
        ).finish()  # type: ignore[no-untyped-call]
    return copy
