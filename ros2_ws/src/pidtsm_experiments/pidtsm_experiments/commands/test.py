"""``./pidtsm test``: ruff, mypy and pytest on the checkout."""

import argparse
import subprocess
import sys
from pathlib import Path

from pidtsm_core.errors import UsageError

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
        "arguments",
        nargs=argparse.REMAINDER,
        metavar="ARGS",
        help="run only pytest, with these arguments (default: run all checks)",
    )


def execute(options: argparse.Namespace) -> int:
    root = next((p for p in Path(__file__).resolve().parents if (p / "pyproject.toml").is_file()), None)
    if root is None:
        raise UsageError("test needs the source checkout")
    if options.arguments:
        return _run(root, "pytest", *options.arguments)
    with subprocess.Popen([sys.executable, "-c", _COMPILE], cwd=root / "tests") as compiling:
        failed = [" ".join(check) for check in _CHECKS if _run(root, *check)]
        compiling.wait()
    failed += [" ".join(_TESTS)] if _run(root, *_TESTS) else []
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _run(root: Path, module: str, *arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", module, *arguments], cwd=root, check=False).returncode
