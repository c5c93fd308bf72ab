"""Files that were made to do harm, or broken in a way of their own: each is read right, or refused in one line."""

import bz2
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias
from zlib import crc32

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin
from support.hostile import Judge, little_memory

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.bags.errors import RecordingError

Change: TypeAlias = Callable[[Path], object]

HEAD = "duration: 2.0\n"
LAW = "controller: {law: {k1: 3.0}}\n"
BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
SCENARIOS: dict[str, tuple[str | bytes, str]] = {
    "plain": (HEAD, ""),
    "mark at the start": (b"\xef\xbb\xbf" + HEAD.encode(), ""),
    "lines of Windows": (HEAD.replace("\n", "\r\n") + LAW, ""),
    "exponent": ("duration: 2e0\n", ""),
    "comments": ("# a\n" * 10_000 + HEAD, ""),
    "one document with its marks": ("---\n" + HEAD + "...\n", ""),
    "long text": (f"description: {'x' * 100_000}\n" + HEAD, ""),
    "every kind of name": ("description: \u00fc \U0001f916\n" + HEAD, ""),
    "empty": ("", "must contain keys and values"),
    "only a comment": ("# nothing\n", "must contain keys and values"),
    "list": ("- 1\n", "must contain keys and values"),
    "text": ("duration\n", "must contain keys and values"),
    "tab": ("controller:\n\tlaw: 1\n", "is not YAML"),
    "null character": (HEAD + "description: a\0b\n", "is not YAML"),
    "control character": (HEAD + "description: a\x07b\n", "is not YAML"),
    "Latin 1": (HEAD.encode() + b"description: \xfc\n", "is not YAML"),
    "UTF-16": (HEAD.encode("utf-16"), "is not YAML"),
    "half a surrogate": (HEAD.encode() + b"description: \xed\xa0\x80\n", "is not YAML"),
    "program": (bytes(range(256)) * 100, "is not YAML"),
    "two documents": (HEAD + "---\n" + HEAD, "is not YAML"),
    "unclosed": (HEAD + "controller: {law: [1, 2\n", "is not YAML"),
    "unclosed quote": (HEAD + 'description: "x\n', "is not YAML"),
    "bomb": (BOMB + HEAD, "aliases (*NAME) are not allowed"),
    "itself": ("a: &a {b: *a}\n", "aliases (*NAME) are not allowed"),
    "anchor": (HEAD + "simulator: &a {seed: 1}\ncontroller: *a\n", "aliases (*NAME) are not allowed"),
    "merge": (HEAD + "controller: {<<: 1}\n", "is not YAML"),
    "merge of a list": (HEAD + "controller: {<<: [1, 2]}\n", "is not YAML"),
    "merge that shadows": (HEAD + "controller: {law.k1: 2.0, <<: {law.k1: 3.0}}\n", "given twice|<<|merge"),
    "deep list": (f"duration: {'[' * 100_000}\n", "more than 20 levels"),
    "deep mapping": (f"duration: {'{a: ' * 10_000}\n", "more than 20 levels"),
    "deep lines": ("".join(f"{' ' * i}a:\n" for i in range(1000)), "more than 20 levels"),
    "key twice": (HEAD + HEAD, "duration is given twice, in lines 1 and 2"),
    "group twice": (HEAD + LAW + LAW, "controller is given twice, in lines 2 and 3"),
    "dots and group": (HEAD + "controller: {law.k1: 2.0, law: {k1: 3.0}}\n", "law.k1 is given twice"),
    "list as key": ("? [a, b]\n: 1\n", "is not YAML"),
    "number as key": (HEAD + "controller: {1: 2}\n", "1 is not a parameter name"),
    "number as name": (HEAD + "1: 2\n", "unknown key 1"),
    "long integer": (f"duration: {'9' * 5000}\n", "an integer of more than 100 digits"),
    "long hexadecimal": (f"duration: 0x{'9' * 5000}\n", "an integer of more than 100 digits"),
    "sixty": ("duration: 190:20:30\n", ""),
    "day that is none": ("duration: 2001-02-30\n", "is not YAML"),
    "day": ("duration: 2001-02-03\n", "must be a positive number of seconds"),
    "code": ("duration: !!python/object/apply:os.system [touch pwned]\n", "is not YAML"),
    "module": ("duration: !!python/module:os\n", "is not YAML"),
    "tag": ("duration: !mine 2.0\n", "is not YAML"),
    "wrong tag": ("duration: !!int x\n", "is not YAML"),
    "binary": ("duration: !!binary x\n", "is not YAML"),
    "for ever": ("duration: 1e300\n", "duration"),
    "infinite": ("duration: .inf\n", "duration"),
    "not a number": ("duration: .nan\n", "duration"),
    "no group": (HEAD + "controller: 1\n", "must be a group of parameters"),
    "unknown node": (HEAD + "recorder: {}\n", "unknown key recorder"),
    "million keys": (HEAD + "".join(f"a{i}: 1\n" for i in range(20_000)), "unknown key a0"),
}
PARAMETERS = {
    "same node twice": ("/**/controller: {ros__parameters: {}}\ncontroller: {ros__parameters: {}}\n", "join them"),
    "same node thrice": ("/controller: {ros__parameters: {}}\ncontroller: {ros__parameters: {}}\n", "join them"),
    "any node": ("/**: {ros__parameters: {law.k1: 1.0}}\n", "unknown node /\\*\\*"),
    "without the word": ("controller: {law.k1: 1.0}\n", "must contain ros__parameters"),
    "more than the word": ("controller: {ros__parameters: {}, a: 1}\n", "must contain ros__parameters"),
    "list of parameters": ("controller: {ros__parameters: [1]}\n", "must be a group of parameters"),
    "no parameters": ("controller: {ros__parameters: }\n", ""),
}
FILES = {f"scenario: {name}": case for name, case in SCENARIOS.items()} | {
    f"parameters: {name}": case for name, case in PARAMETERS.items()
}


@pytest.fixture(autouse=True)
def _little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    with little_memory():
        yield


def test_hostile_scenarios_and_parameters_are_read_right_or_refused_by_name(tmp_path: Path) -> None:
    judge, unexpected = Judge(UsageError), []
    assert len(FILES) > 40

    def use(kind: str) -> None:
        experiment = (
            make_experiment("file.yaml") if kind == "scenario" else make_experiment("case1", params=["file.yaml"])
        )
        assert experiment.duration > 0.0

    for name, (content, reason) in FILES.items():
        file = tmp_path / "file.yaml"
        file.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        refusal = judge.use(name, partial(use, name.partition(":")[0]), "file.yaml")
        if bool(refusal) != bool(reason) or not any(word in refusal for word in reason.replace("\\", "").split("|")):
            unexpected.append(f"{name}: {refusal!r:.300}")
    judge.conclude(5, len(FILES) - 30)
    assert not unexpected, "\n".join(unexpected)
    assert [path.name for path in tmp_path.iterdir()] == ["file.yaml"]


# Changes of a bag's folder. Some need one of the two kinds of bags.


def data(bag: Path) -> Path:
    return next(file for file in bag.iterdir() if file.suffix in (".mcap", ".db3"))


def changed(edit: Callable[[bytes], bytes], metadata: bool = False) -> Change:
    def change(bag: Path) -> None:
        file = bag / "metadata.yaml" if metadata else data(bag)
        file.write_bytes(edit(file.read_bytes()))

    return change


def replaced(*keys: str, value: object) -> Change:
    """Another value in metadata.yaml."""

    def change(bag: Path) -> None:
        file = bag / "metadata.yaml"
        content = yaml.safe_load(file.read_text())
        branch: Any = content["rosbag2_bagfile_information"]
        for key in keys[:-1]:
            branch = branch[int(key) if key.isdigit() else key]
        branch[keys[-1]] = value
        file.write_text(yaml.safe_dump(content))

    return change


def statements(*lines: str) -> Change:
    """SQL in the data base of a bag; in an MCAP file, noise at the place that depends on it."""

    def change(bag: Path) -> None:
        if data(bag).suffix == ".mcap":
            content = bytearray(data(bag).read_bytes())
            content[crc32(lines[0].encode()) % len(content)] ^= 0xFF
            data(bag).write_bytes(bytes(content))
            return
        with sqlite3.connect(data(bag)) as base:
            for line in lines:
                base.execute(line)

    return change


def linked(bag: Path) -> None:
    file = data(bag)
    shutil.move(file, bag.parent / "elsewhere")
    file.symlink_to(bag.parent / "elsewhere")


def circle(bag: Path) -> None:
    file = data(bag)
    file.unlink()
    file.symlink_to(file.name)


def folder_for_a_file(bag: Path) -> None:
    file = data(bag)
    file.unlink()
    file.mkdir()


def without_files(bag: Path) -> None:
    for file in bag.iterdir():
        file.unlink()


HUGE = struct.pack("<Q", 2**62)
CHANGES: dict[str, Change] = {
    "nothing": lambda bag: None,
    "no data": lambda bag: data(bag).unlink(),
    "no metadata": lambda bag: (bag / "metadata.yaml").unlink(),
    "no files": without_files,
    "empty data": changed(lambda old: b""),
    "empty metadata": changed(lambda old: b"", metadata=True),
    "one byte": changed(lambda old: old[:1]),
    "magic alone": changed(lambda old: old[:8]),
    "half": changed(lambda old: old[: len(old) // 2]),
    "all but a byte": changed(lambda old: old[:-1]),
    "another magic": changed(lambda old: b"\x89PNG\r\n\x1a\n" + old[8:]),
    "zeros": changed(lambda old: bytes(len(old))),
    "ones": changed(lambda old: b"\xff" * len(old)),
    "twice": changed(lambda old: old + old),
    "noise behind": changed(lambda old: old + bytes(range(256)) * 40),
    "noise before": changed(lambda old: bytes(range(256)) + old),
    "hole": changed(lambda old: old[:2000] + bytes(4096) + old[6096:]),
    "huge record": changed(lambda old: old[:9] + HUGE + old[17:]),
    "huge record in the middle": changed(lambda old: old[: len(old) // 2] + HUGE + old[len(old) // 2 + 8 :]),
    "huge numbers everywhere": changed(lambda old: old[:100] + HUGE * ((len(old) - 200) // 8) + old[-100:]),
    "huge footer": changed(lambda old: old[:-36] + b"\x02" + struct.pack("<QQQI", 20, 2**63, 2**63, 1) + old[-8:]),
    "checksum": changed(lambda old: old[:-12] + b"\1\2\3\4" + old[-8:]),
    "compressed whole": changed(bz2.compress),
    "other text": changed(lambda old: b"%YAML:1.0\n---\na: 1\n"),
    "metadata of zeros": changed(lambda old: bytes(len(old)), metadata=True),
    "metadata of a list": changed(lambda old: b"[1, 2]", metadata=True),
    "metadata with code": changed(lambda old: b"!!python/object/apply:os.getcwd []", metadata=True),
    "metadata that is a bomb": changed(lambda old: BOMB.encode(), metadata=True),
    "metadata that is deep": changed(lambda old: b"[" * 100_000, metadata=True),
    "another version": replaced("version", value=999),
    "version that is text": replaced("version", value="nine"),
    "another storage": replaced("storage_identifier", value="floppy"),
    "files of somebody": replaced("relative_file_paths", value=["../../../etc/passwd"]),
    "files for ever": replaced("relative_file_paths", value=["/dev/zero"]),
    "no files named": replaced("relative_file_paths", value=[]),
    "files that are numbers": replaced("relative_file_paths", value=[1]),
    "null in a name": replaced("relative_file_paths", value=["a\0b"]),
    "compression": replaced("compression_format", value="zstd"),
    "compression that is none": replaced("compression_mode", value="FILE"),
    "huge count": replaced("message_count", value=2**62),
    "negative count": replaced("message_count", value=-1),
    "huge duration": replaced("duration", "nanoseconds", value=10**400),
    "no topics": replaced("topics_with_message_count", value=[]),
    "other type": replaced("topics_with_message_count", "0", "topic_metadata", "type", value="mine/msg/Nothing"),
    "text for a type": replaced("topics_with_message_count", "0", "topic_metadata", "type", value="/"),
    "text for a topic": replaced("topics_with_message_count", "0", "topic_metadata", "name", value=""),
    "text for a count": replaced("topics_with_message_count", "0", "message_count", value="many"),
    "no messages": statements("DELETE FROM messages"),
    "no table": statements("DROP TABLE messages"),
    "no topic": statements("DELETE FROM topics"),
    "other types": statements("UPDATE topics SET type = 'std_msgs/msg/String'"),
    "unknown types": statements("UPDATE topics SET type = 'mine/msg/Nothing'"),
    "type without slashes": statements("UPDATE topics SET type = 'x'"),
    "types that are numbers": statements("UPDATE topics SET type = 1"),
    "empty messages": statements("UPDATE messages SET data = x''"),
    "messages that are numbers": statements("UPDATE messages SET data = 1"),
    "text messages": statements("UPDATE messages SET data = 'text'"),
    "short messages": statements("UPDATE messages SET data = substr(data, 1, 20)"),
    "huge messages": statements("UPDATE messages SET data = x'00010000ffffffffffffffffffffffffffffffffffffffff'"),
    "one time": statements("UPDATE messages SET timestamp = 0"),
    "time that is text": statements("UPDATE messages SET timestamp = 'soon'"),
    "time before": statements("UPDATE messages SET timestamp = -timestamp - 9000000000000000000"),
    "link": linked,
    "link in a circle": circle,
    "folder for a file": folder_for_a_file,
}
MUST_READ = {"nothing", "no metadata", "link"}


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_hostile_bags_are_read_or_refused_by_name(tmp_path: Path, write_bag: Any, plugin: StoragePlugin) -> None:
    good, judge = write_bag(tmp_path / "good", rollout(duration=0.02), plugin=plugin), Judge(RecordingError)
    assert len(CHANGES) > 40
    results: dict[str, str] = {}
    for name, change in CHANGES.items():
        shutil.copytree(good, tmp_path / "bag")
        change(tmp_path / "bag")
        results[name] = judge.use(name, lambda: analyze(tmp_path / "bag")["samples"], str(tmp_path / "bag"))
        shutil.rmtree(tmp_path / "bag")
    judge.conclude(3, len(CHANGES) - 10)
    assert {name for name in MUST_READ if not results[name]} == MUST_READ, results
