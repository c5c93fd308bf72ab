"""``./pidtsm test``: ruff, mypy and pytest over the checkout."""

import argparse
import subprocess
import sys
from pathlib import Path

from pidtsm_experiments.errors import UsageError

_CHECKS = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "arguments",
        nargs=argparse.REMAINDER,
        metavar="ARGS",
        help="passed on to pytest, which then runs alone; without any, everything is checked",
    )


def execute(options: argparse.Namespace) -> int:
    root = next((p for p in Path(__file__).resolve().parents if (p / "pyproject.toml").is_file()), None)
    if root is None:
        raise UsageError("test needs the source checkout")
    failed = []
    if not options.arguments:
        failed = [" ".join(check) for check in _CHECKS if _run(root, *check)]
    if _run(root, "pytest", *options.arguments):
        failed.append("pytest")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _run(root: Path, module: str, *arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", module, *arguments], cwd=root, check=False).returncode
