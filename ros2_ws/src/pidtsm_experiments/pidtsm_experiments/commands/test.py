"""``./pidtsm test``: ruff, mypy and pytest over the checkout."""

import argparse
import subprocess
import sys
from pathlib import Path

from pidtsm_experiments.errors import UsageError

_CHECKS = (
    ("ruff", "check", "."),
    ("ruff", "format", "--check", "."),
    ("mypy",),
    # Nothing in the packages' own tests minds what else the machine does.
    ("pytest", "--numprocesses", "auto", "ros2_ws/src"),
    # These are real nodes in real time: a machine that stands still for a moment is told from a defect by a second try,
    # which the summary names.
    ("pytest", "--reruns", "2", "-rR", "tests"),
)


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
    checks = (("pytest", *options.arguments),) if options.arguments else _CHECKS
    failed = [" ".join(check) for check in checks if _run(root, *check)]
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _run(root: Path, module: str, *arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", module, *arguments], cwd=root, check=False).returncode
