"""``./pidtsm test``: ruff, mypy and pytest on the checkout."""

import argparse
import subprocess
import sys
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.affected_tests import Sources, changed_files

_CHECKS = (
    ("ruff", "check", "."),
    ("ruff", "format", "--check", "."),
    ("mypy",),
)
_COMPILE = "import support.nursery_preload; from pidtsm_core.rollouts.closed_loop import rollout; rollout(duration=0.1)"
"""Run beside the checks: once, and not in each process of the tests at the same time."""
# The tests of a file share nodes, so they stay together.
_TESTS = ("pytest", "--numprocesses", "2", "--dist", "loadfile", "--no-loadscope-reorder")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--changed",
        nargs="?",
        const="HEAD",
        metavar="COMMIT",
        help="run all checks, but only the tests that changes since COMMIT (default: the last one) can break",
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
    if options.arguments and options.changed is None:
        return _run(root, "pytest", *options.arguments)
    files = _affected(root, options.changed) if options.changed else []
    with subprocess.Popen([sys.executable, "-c", _COMPILE], cwd=root / "tests") as compiling:
        failed = [" ".join(check) for check in _CHECKS if _run(root, *check)]
        compiling.wait()
    if files is not None:
        failed += [" ".join(_TESTS)] if _run(root, *_TESTS, *options.arguments, *files) else []
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


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
    return subprocess.run([sys.executable, "-m", module, *arguments], cwd=root, check=False).returncode
