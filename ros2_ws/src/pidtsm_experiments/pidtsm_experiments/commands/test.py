"""``./pidtsm test``: ruff, mypy and pytest on the checkout."""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_experiments.affected_tests import Sources, changed_files

_STYLE = (("ruff", "check", "."), ("ruff", "format", "--check", "."))
_TYPES = ("mypy",)
_COMPILE = "import support.nursery_preload; from pidtsm_core.rollouts.closed_loop import rollout; rollout(duration=0.1)"
"""Run before the tests: once, and not in each of their processes at the same time."""
# The tests of a file share nodes, so they stay together. Loops in real time bear no more processes than cores.
_TESTS = ("pytest", "--numprocesses", "2", "--dist", "loadfile", "--no-loadscope-reorder")
_NONE_CHOSEN = 5
"""Exit code of pytest where its options choose none of the tests."""
_ALONE = "*_realtime.py"
"""Files whose tests need a quiet machine: they run at the end, with nothing beside them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--changed",
        nargs="?",
        const="HEAD",
        metavar="COMMIT",
        help="run all checks, but only the tests that changes since COMMIT (default: the last one) can break",
    )
    parser.add_argument(
        "--long",
        action="store_true",
        help="run also the tests that take minutes: the offline bundle, the oldest Python, a commissioning by clicks",
    )
    parser.add_argument(
        "arguments",
        nargs=argparse.REMAINDER,
        metavar="ARGS",
        help="run only pytest, with these arguments: options of pytest, files, tests (default: run all checks)",
    )


def execute(options: argparse.Namespace) -> int:
    root = next((p for p in Path(__file__).resolve().parents if (p / "pyproject.toml").is_file()), None)
    if root is None:
        raise UsageError("test needs the source checkout")
    arguments = [*(["-m", ""] if options.long else []), *options.arguments]
    if options.arguments and options.changed is None:
        return _run(root, "pytest", *arguments)
    files = _affected(root, options.changed) if options.changed else []
    # The types take one processor for as long as compiling and the first tests take the other.
    with TemporaryFile("w+") as output, _start(root, *_TYPES, stdout=output, stderr=output) as types:
        with subprocess.Popen([sys.executable, "-c", _COMPILE], cwd=root / "tests"):
            failed = [" ".join(check) for check in _STYLE if _run(root, *check)]
        if files is not None:
            failed += _test(root, arguments, files)
        if types.wait():
            failed.append(" ".join(_TYPES))
        output.seek(0)
        sys.stdout.write(output.read())
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _test(root: Path, arguments: Sequence[str], files: Sequence[str]) -> list[str]:
    """Run these files of tests, or all; returns the commands that failed."""
    alone = [name for name in files if Path(name).match(_ALONE)]
    together = [name for name in files if name not in alone]
    commands = []
    if together or not files:
        commands.append([*_TESTS, f"--ignore-glob={_ALONE}", *arguments, *together])
    if alone or not files:
        commands.append(["pytest", *arguments, *(alone or map(str, sorted(root.glob(f"tests/{_ALONE}"))))])
    passed = (0, _NONE_CHOSEN) if arguments else (0,)
    return [" ".join(words) for words in commands if _run(root, *words) not in passed]


def _affected(root: Path, since: str) -> list[str] | None:
    """Files of the tests that a change can break; none: all tests; None: it can break none.

    Raises:
        UsageError: git does not know the commit.
    """
    changed = changed_files(root, since)
    files = Sources(root).tests(changed)
    if files is None:
        print(f"{len(changed)} changed files; they may concern every test", file=sys.stderr)
        return []
    print(f"{len(changed)} changed files can break {len(files)} files of tests", file=sys.stderr)
    return files or None


def _run(root: Path, module: str, *arguments: str) -> int:
    return _start(root, module, *arguments).wait()


def _start(root: Path, module: str, *arguments: str, **options: Any) -> "subprocess.Popen[bytes]":
    # Each process of pytest imports all files of tests: they are compiled once, whatever the environment says. Where
    # several processes share the processors, threads of BLAS only wait for each other.
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    return subprocess.Popen([sys.executable, "-m", module, *arguments], cwd=root, env=environment, **options)
