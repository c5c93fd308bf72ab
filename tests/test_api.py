"""docs/api.md has every public name, and each states the shapes and units of its arrays."""

import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pidtsm_core

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import api  # noqa: E402

UNIT = re.compile(r"\b(rad|m|N m|s|ns|units?|dimensionless)\b")


def test_page_is_up_to_date() -> None:
    assert api.PAGE.read_text(encoding="utf-8") == api.page(), (
        'regenerate it: ./pidtsm shell -c "python scripts/api.py"'
    )


def documented(name: str) -> Iterator[tuple[str, str, str]]:
    """Heading on the page, docstring and annotations of a public name and of its members."""
    each = getattr(pidtsm_core, name)
    yield f"## {name}", each.__doc__ or "", " ".join(map(str, vars(each).get("__annotations__", {}).values()))
    for member, function in api.members(each).items() if inspect.isclass(each) else ():
        code = function.fget if isinstance(function, property) else getattr(function, "__func__", function)
        yield f"### {name}.{member}", function.__doc__ or "", " ".join(map(str, code.__annotations__.values()))


@pytest.mark.parametrize("name", pidtsm_core.__all__)
def test_a_public_name_is_described_with_shapes_and_units(name: str) -> None:
    page = api.page()
    for heading, text, annotations in documented(name):
        assert f"\n{heading}\n" in page
        assert text.strip(), heading
        if re.search("Array|float64", annotations) and "see `" not in text.lower():
            assert "shape" in text, heading
            assert UNIT.search(text), heading


def test_public_names_are_those_for_type_checkers() -> None:
    text = inspect.getsource(pidtsm_core).partition("if TYPE_CHECKING:")[2].partition("_MODULES")[0]
    imported = re.findall(r"\w+", " ".join(re.findall(r"import (.*)", text)))
    assert sorted(imported) == pidtsm_core.__all__ == sorted(pidtsm_core._MODULES)
    assert set(pidtsm_core.__all__) <= set(dir(pidtsm_core))


def test_an_unknown_name_is_an_attribute_error() -> None:
    unknown: Any = "rolout"
    with pytest.raises(AttributeError, match="rolout"):
        getattr(pidtsm_core, unknown)


def test_importing_it_imports_no_compiler() -> None:
    code = "import sys, pidtsm_core; assert not {'numba', 'numpy'} & set(sys.modules); pidtsm_core.UsageError"
    subprocess.run([sys.executable, "-c", code], check=True)
