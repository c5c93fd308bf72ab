"""What is public states what it takes and gives: shapes, errors, and for what comes from the literature its source."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "ros2_ws" / "src"
FILES = sorted(
    file
    for package in SOURCES.iterdir()
    for file in (package / package.name).rglob("*.py")
    if "commands" not in file.parts  # Their package states what the two functions of each module do.
)
ELSEWHERE = re.compile(r"\b[Ss]ee `|[Aa]rguments as those of `")
FROM_LITERATURE = ("laws/surfaces", "laws/reaching", "laws", "estimators", "simulation/disturbances", "robots")
FAMILIES = {Path(family).name for family in (*FROM_LITERATURE, "references")}
SHARED = (
    "__init__",
    "base",
    "baseline",
    "bounds",
    "calls",
    "chains",
    "compiler",
    "confined",
    "definition",
    "description",
    "effort_differences",
    "errors",
    "expansion",
    "none",
    "other_joints",
    "own",
    "payload",
    "picture",
    "placement",
    "rigid_bodies",
    "sampled",
    "source",
    "stored",
    "trial",
    "tree_robot",
    "urdf",
)
SOURCE = re.compile(r"eqs?\. \(|article|Remark \d|\b(19|20)\d\d\b")

Definition = ast.FunctionDef | ast.AsyncFunctionDef


def told_by_the_base(file: Path) -> set[str]:
    """Names of the functions of a family's members whose arguments the family's base describes."""
    base = file.with_name("base.py")
    if file.parent.name not in FAMILIES or file.stem in ("__init__", "base"):
        return set()
    text = base.read_text(encoding="utf-8")
    assert "shape" in text
    return set(re.findall(r"^    (\w+): ", text, flags=re.MULTILINE))


def public_functions(tree: ast.Module) -> Iterator[tuple[str, Definition, str]]:
    """Name, definition and docstring (of a class with it for its __init__) of every public function and method."""
    for node in tree.body:
        if isinstance(node, Definition) and not node.name.startswith("_"):
            yield node.name, node, ast.get_docstring(node) or ""
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for member in node.body:
                if isinstance(member, Definition) and (member.name == "__init__" or not member.name.startswith("_")):
                    text = ast.get_docstring(member) or ""
                    if member.name == "__init__":
                        text += "\n" + (ast.get_docstring(node) or "")
                    yield f"{node.name}.{member.name}", member, text


def takes_arrays(function: Definition) -> bool:
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    annotations = [a.annotation for a in arguments if a.annotation] + ([function.returns] if function.returns else [])
    return any(re.search(r"\b(Array|NDArray|ArrayLike)\b", ast.unparse(each)) for each in annotations)


def raised(function: Definition) -> set[str]:
    """Names of the exceptions that the function raises itself, nested functions aside."""
    found: set[str] = set()
    waiting: list[ast.AST] = [*function.body]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.FunctionDef, ast.Lambda, ast.ClassDef)):
            continue
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            found.add(node.exc.func.id)
        waiting += ast.iter_child_nodes(node)
    return found


def untold(file: Path) -> list[str]:
    """Functions of a file that take arrays without a word of shapes, or raise an error that they do not tell."""
    lacking = []
    known, module = told_by_the_base(file), ast.parse(file.read_text(encoding="utf-8"))
    once = "Shapes in this module: " in (ast.get_docstring(module) or "")
    for name, function, text in public_functions(module):
        if (
            not once
            and name not in known
            and takes_arrays(function)
            and not ("shape" in text or ELSEWHERE.search(text))
        ):
            lacking.append(f"{name}: no shapes")
        lacking += [f"{name}: raises {error} unsaid" for error in sorted(raised(function)) if error not in text]
    return lacking


def test_shapes_and_errors_are_told() -> None:
    assert len(FILES) > 300
    assert {str(file.relative_to(SOURCES)): lacking for file in FILES if (lacking := untold(file))} == {}


@pytest.mark.parametrize("family", FROM_LITERATURE)
def test_what_comes_from_the_literature_names_its_source(family: str) -> None:
    files = sorted((SOURCES / "pidtsm_core" / "pidtsm_core" / family).glob("*.py"))
    assert files
    for file in files:
        if file.stem not in SHARED:
            assert SOURCE.search(file.read_text(encoding="utf-8")), f"{file.name} names no source"
