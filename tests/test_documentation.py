"""The documents keep their word: commands run, examples work as written, links lead somewhere."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
import pytest
from support.nursery import begin, forked_command
from support.registered import forget

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs import blind
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_studies.blind.arms import blind_arm

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *ROOT.glob("docs/**/*.md")])
DEADLINE = 300.0
"""s for the commands of one block; only a failing test takes that long."""
ENDING = 10.0
"""s; likewise."""
BLIND = 5.0
"""s of the blind arm, instead of 20; test_diagnose.py judges what is found in recordings."""

_FENCE = re.compile(r"^```(\w+)[ \t]*([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TITLE = re.compile(r'title="([^"]+)"')
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_RECURSIVE = re.compile(r"^\./pidtsm test\b.*$", re.MULTILINE)
# Take long; test_reproduction.py, test_closed_loop.py and the command's own test run them.
_LONG = re.compile(r"^\./pidtsm (reproduce --out \S+|demo|score --quick .*|tune .*)$", re.MULTILINE)
_PLAIN = re.compile(
    r"(\./pidtsm (?!shell|actions|live|move)[a-z]\S*( [^$&|;<>`\n]*)?( \|\| (true|test \$\? = 1))?\n|\s*\n)+"
)
"""Commands that need no shell, also where they may fail."""
_JOINS = re.compile(r"^\./pidtsm (nodes|replay-motion) ", re.MULTILINE)
"""Commands that join a graph, for which they need a process of their own."""
_SECONDS = re.compile(r"^(\./pidtsm (?:run|rollout|reproduce) .*--duration )[23]\b", re.MULTILINE)
"""Runs that show nothing more in seconds than in half of one."""
_REAL_TIME = re.compile(r"^(\./pidtsm (?:nodes start .*--plant|run .*--clock realtime)\b)", re.MULTILINE)
"""Loops in real time, which take most of a machine at 1 kHz."""


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        language: first word after the fence.
        information: the rest of that line.
        content: the lines between the fences.
    """

    language: str
    information: str
    content: str

    @property
    def title(self) -> str | None:
        """The file that the block is, or changes."""
        found = _TITLE.search(self.information)
        return found.group(1) if found else None


def blocks(document: Path) -> list[Block]:
    return [Block(*found.groups()) for found in _FENCE.finditer(document.read_text(encoding="utf-8"))]


def named(document: Path) -> str:
    return str(document.relative_to(ROOT))


@pytest.fixture
def environment(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, str]]:
    """Of a reader who has stored no arm."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("configuration")))
    begin()
    monkeypatch.setattr(blind, "blind_arm", partial(blind_arm, duration=BLIND))
    with own_domain() as domain:
        yield {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    forget()


def run_script(script: str, folder: Path, environment: dict[str, str]) -> None:
    """Run a block as one script; what it leaves running fails the test."""
    # A domain that the text chooses could be that of another test.
    script = re.sub(r"ROS_DOMAIN_ID=\d+", f"ROS_DOMAIN_ID={environment['ROS_DOMAIN_ID']}", script)
    with (folder / "output.txt").open("w+") as output:
        process = subprocess.Popen(
            ["bash", "-euo", "pipefail", "-c", script],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = process.wait(DEADLINE)
        finally:
            remaining = _end_session(process.pid)
            process.wait()
            remaining |= _end_detached(folder)
        output.seek(0)
        text = output.read()
    assert code == 0, f"exit code {code}:\n{script}\n{text}"
    assert not remaining, f"still running after:\n{script}\n{text}"


def _end_session(session: int) -> bool:
    """Kill what is left of a session's first process group; returns whether there was anything."""
    try:
        os.killpg(session, 9)
    except ProcessLookupError:
        return False
    return True


def _working_in(folder: Path) -> list[psutil.Process]:
    """The processes that work in a folder, whatever their session, but for those of the test."""
    # The one that forks nodes and commands for all tests of this process may have been started there.
    own = psutil.Process()
    spared, found = {own, *own.children(recursive=True)}, []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.cwd() == str(folder) and process not in spared:
                found.append(process)
    return found


def _end_detached(folder: Path) -> bool:
    """Kill the processes that work in a folder; returns whether there were any."""
    found = _working_in(folder)
    for process in found:
        with suppress(psutil.Error):
            process.kill()
    return bool(found)


def _all_have_ended(folder: Path) -> bool:
    """Whether, soon, no process works in a folder any more: what forked a command's nodes ends a moment after it."""
    end = time.monotonic() + ENDING
    while _working_in(folder) and time.monotonic() < end:
        time.sleep(0.05)
    return not _end_detached(folder)


def commands(document: Path, *, ros2: bool) -> list[Block]:
    """What a reader can run as it stands, bash and Python; with `ros2` what needs its command line."""
    found = [
        block
        for block in blocks(document)
        if (block.language == "bash" and "example" not in block.information)
        or (block.language == "python" and not block.title)
    ]
    return [block for block in found if bool(re.search(r"\bros2 ", block.content)) == ros2]


def run_commands(document: Path, folder: Path, environment: dict[str, str], *, ros2: bool) -> None:
    """Run the blocks in their order, as if in a checkout, with the files that the text gives.

    Plain commands and Python run in this process, which has imported everything, or in one that is forked.
    """
    for name in ("pidtsm", "pyproject.toml", "ros2_ws", "tests"):
        (folder / name).symlink_to(ROOT / name)
    for block in blocks(document):
        if block.title and not block.title.startswith("ros2_ws/"):
            (folder / block.title).write_text(block.content, encoding="utf-8")
    for block in commands(document, ros2=ros2):
        if block.language == "python":
            exec(compile(block.content, str(document), "exec"), {})
            continue
        for line in _RECURSIVE.findall(block.content):
            check_test_command(line)
        script = _SECONDS.sub(r"\g<1>0.5", _LONG.sub("", _RECURSIVE.sub("", block.content)))
        script = _REAL_TIME.sub(r"\1 --set simulator.rate=250", script)
        if _PLAIN.fullmatch(script):
            for line in filter(str.strip, script.splitlines()):
                command, _, failing = line.partition(" || ")
                allowed = {"": (0,), "true": (0, 1), "test $? = 1": (1,)}[failing]
                code = run_plain(shlex.split(command)[1:], folder, environment, alone=bool(_JOINS.search(script)))
                assert code in ((1,) if block.information == "fails" else allowed), line
            assert not _JOINS.search(script) or _all_have_ended(folder), f"still running after:\n{script}"
        else:
            run_script(script, folder, environment)


def run_plain(words: list[str], folder: Path, environment: dict[str, str], *, alone: bool) -> int:
    """The exit code of a command, in this process or, `alone`, in a forked one."""
    if not alone:
        return main(words)
    log = folder / "output.txt"
    code = forked_command(words, folder, environment, log).wait(DEADLINE)
    print(log.read_text("utf-8"))
    return code


@pytest.mark.parametrize("document", [d for d in DOCUMENTS if commands(d, ros2=False)], ids=named)
def test_commands_run(
    document: Path, tmp_path: Path, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        run_commands(document, tmp_path, environment, ros2=False)
    finally:  # Nodes that a failed block has left would take the machine from all other tests.
        _end_detached(tmp_path)


@pytest.mark.skipif(shutil.which("ros2") is None, reason="no ros2 command line here: the wheels have none")
@pytest.mark.parametrize("document", [d for d in DOCUMENTS if commands(d, ros2=True)], ids=named)
def test_ros2_commands_run(
    document: Path, tmp_path: Path, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run_commands(document, tmp_path, environment, ros2=True)


def check_test_command(line: str) -> None:
    """Running the tests from a test would not end; what they are given must exist."""
    for word in line.partition("#")[0].split()[2:]:
        assert word in ("--changed", "--long") or (ROOT / word.partition("::")[0]).exists(), line


def test_examples_of_new_members_work(tmp_path: Path, environment: dict[str, str]) -> None:
    """All code of the documents, in one copy of the core with the registry lines they give, and its commands."""
    source = Path("ros2_ws/src/pidtsm_core")
    copy = tmp_path / source
    shutil.copytree(ROOT / source, copy, ignore=shutil.ignore_patterns("__pycache__"))
    example = [block for document in DOCUMENTS for block in blocks(document)]
    for block in example:
        if block.title and block.title.startswith(str(source)):
            target = tmp_path / block.title
            if block.language == "diff":
                target.write_text(patched(target.read_text(encoding="utf-8"), block.content), encoding="utf-8")
            else:
                assert not target.exists(), f"{block.title} exists; the example needs another name"
                target.write_text(block.content, encoding="utf-8")
    with_copy = {
        **environment,
        "PYTHONPATH": os.pathsep.join(filter(None, (str(copy), environment.get("PYTHONPATH")))),
        # The caches of the real core stay as they are.
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "NUMBA_OPT": "0",  # What is compiled runs once.
    }
    scripts = [b.content for b in example if b.language == "bash" and "example" in b.information]
    assert len(scripts) == 1
    # All in one process, as a start takes as long as a rollout.
    words = [shlex.split(line)[1:] for script in scripts for line in script.splitlines()]
    program = f"import sys; from pidtsm_experiments.cli import main; sys.exit(any([main(each) for each in {words!r}]))"
    run_script(shlex.join([sys.executable, "-c", program]), tmp_path, with_copy)


def patched(text: str, difference: str) -> str:
    """Insert the lines marked ``+``, each after the context line before it."""
    lines = text.splitlines()
    place = 0
    for line in difference.splitlines():
        if line.startswith("+"):
            lines.insert(place, line[1:])
        else:
            assert line[1:] in lines[place:], f"no line {line[1:]!r} to go by"
            place = lines.index(line[1:], place)
        place += 1
    return "\n".join(lines) + "\n"


def test_examples_are_of_the_projects_style(tmp_path: Path) -> None:
    code = [b for document in DOCUMENTS for b in blocks(document) if b.language == "python"]
    for number, block in enumerate(code):
        (tmp_path / f"example_{number}.py").write_text(block.content, encoding="utf-8")
    configuration = ["--config", str(ROOT / "pyproject.toml")]
    # Members of a family share a signature, whether they use all of it or not.
    for check in (["check", "--extend-ignore", "ARG"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *check, *configuration, str(tmp_path)], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_links_lead_to_files(document: Path) -> None:
    text = _FENCE.sub("", document.read_text(encoding="utf-8"))
    for link in _LINK.findall(text):
        path, _, anchor = link.partition("#")
        if re.match(r"\w+:", path):
            continue
        target = document.parent / path if path else document
        assert target.exists(), f"{named(document)} links to {link}"
        if anchor:
            assert anchor in anchors(target), f"{named(document)} links to {link}"


def anchors(document: Path) -> list[str]:
    """Names of the headings, as they are linked to."""
    text = _FENCE.sub("", document.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]
