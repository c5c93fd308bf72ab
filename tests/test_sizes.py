"""Functions fit on a screen, files can be read at one go, and the README in two minutes."""

import ast
import os
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST_FUNCTION = 60
LONGEST_FILE = 400
"""Lines; tests may be longer, as they are read one by one."""
NOT_OURS = {"build", "install", "log", "results", "__pycache__"}


def sources() -> Iterator[Path]:
    for folder, below, files in os.walk(ROOT):
        below[:] = [name for name in below if name not in NOT_OURS and not name.startswith(".")]
        yield from (Path(folder, name) for name in files if name.endswith(".py"))


FILES = sorted(sources())


def named(file: Path) -> str:
    return str(file.relative_to(ROOT))


def test_no_function_is_long() -> None:
    assert Path(__file__).resolve() in FILES
    too_long = []
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_bytes())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > LONGEST_FUNCTION:
                    too_long.append(f"{named(file)}: {node.name} has {lines} lines")
    assert not too_long, "\n".join(too_long)


def test_no_file_is_long() -> None:
    lines = {
        named(file): len(file.read_bytes().splitlines())
        for file in FILES
        if not {"test", "tests"} & set(file.relative_to(ROOT).parts)
    }
    too_long = [f"{name} has {count} lines" for name, count in lines.items() if count > LONGEST_FILE]
    assert not too_long, "\n".join(too_long)


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 600
