"""Generates docs/api.md from the docstrings of the public names of pidtsm_core and pidtsm_studies.

./pidtsm shell -c "python scripts/api.py"
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any

import pidtsm_core
import pidtsm_studies

PAGE = Path(__file__).resolve().parents[1] / "docs" / "api.md"

_HEAD = """# Python interface

`scripts/api.py` generates this page from docstrings. [examples](../examples) has twelve scripts and three notebooks
that use this interface. An `Array` is a NumPy array of float64; a `Value` is a number, a text, a truth value or a
sequence of them. The other types are in [Types](#types), those of Python, NumPy, Matplotlib, pandas and xarray in
their own documentation.

`pip install ".[tables,dask,xacro]"` in the checkout [installs it without ROS](distribution.md) and with these extras:
`tables` (pandas, xarray) is for `Recording.to_pandas` and `Recording.to_xarray`, `dask` for `batch` on a
[cluster](../examples/dask_cluster.py), `xacro` for arms in that format.
"""
_SECTION = re.compile(r"(Args|Attributes|Returns|Raises):$")
_ENTRY = re.compile(r"    (\w[\w, ]*): (.*)")
_MEMBER = re.compile(r"^    (\w+) = \d+(?:  # (.*))?$", re.MULTILINE)


def page() -> str:
    """Content of the page."""
    parts = [_HEAD, _text(inspect.getdoc(pidtsm_core) or "")]
    for name in pidtsm_core.__all__:
        parts += _described(name, getattr(pidtsm_core, name))
    parts += ["# Studies", _text(inspect.getdoc(pidtsm_studies) or "")]
    for name in pidtsm_studies.__all__:
        parts += _described(name, getattr(pidtsm_studies, name))
    parts += ["# Types", "What the signatures above name and no public name is."]
    for name, each in other_types().items():
        parts += [f"## {name}", f"`{each.__module__}.{each.__qualname__}`", _text(inspect.getdoc(each) or "")]
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def other_types() -> dict[str, type]:
    """The project's classes in the annotations of what is public that are not public themselves, by name."""
    public = {*pidtsm_core.__all__, *pidtsm_studies.__all__}
    found: dict[str, type] = {}
    for each in (getattr(package, name) for package in (pidtsm_core, pidtsm_studies) for name in package.__all__):
        names = vars(sys.modules[each.__module__])
        for word in sorted(set(re.findall(r"\b[A-Z]\w+", " ".join(_annotations(each))))):
            kind = names.get(word)
            if inspect.isclass(kind) and kind.__module__.startswith("pidtsm") and kind.__name__ not in public:
                found[kind.__name__] = kind
    return dict(sorted(found.items()))


def _annotations(each: Any) -> Iterator[str]:
    """The annotations of a function, or of a class with its public methods, as texts."""
    owners = [each]
    if inspect.isclass(each):
        owners += [getattr(member, "__func__", getattr(member, "fget", member)) for member in members(each).values()]
    for owner in owners:
        yield from map(str, getattr(owner, "__annotations__", {}).values())


def members(owner: type) -> dict[str, Any]:
    """Public methods and properties that a class itself defines."""
    kinds = (property, classmethod, staticmethod)
    own = {name: each for name, each in vars(owner).items() if inspect.isfunction(each) or isinstance(each, kinds)}
    return {name: each for name, each in own.items() if not name.startswith("_")}


def _described(name: str, each: Any) -> Iterator[str]:
    """Heading, signature and docstring of a public name, and of the members of a class."""
    yield f"## {name}"
    if inspect.isfunction(each):
        yield _signature(name, each)
    yield _text(inspect.getdoc(each) or "")
    if inspect.isclass(each) and issubclass(each, IntEnum):
        rows = (f"| {value.value} | `{value.name}` | {_comments(each)[value.name]} |" for value in each)
        yield "\n".join(["| value | name | meaning |", "| --- | --- | --- |", *rows])
    elif inspect.isclass(each) and not issubclass(each, BaseException):
        for member, function in members(each).items():
            yield f"### {name}.{member}"
            if inspect.isfunction(function):
                yield _signature(member, function)
            yield _text(inspect.getdoc(function) or "")


def _comments(enum: type[IntEnum]) -> dict[str, str]:
    """The comment of each value."""
    return dict(_MEMBER.findall(inspect.getsource(enum)))


def _signature(name: str, function: Callable[..., Any]) -> str:
    """The signature as code, on one line if it is short."""
    signature = inspect.signature(function)
    kept = [p for p in signature.parameters.values() if p.name != "self"]
    line = f"{name}{_plain(signature.replace(parameters=kept))}"
    if len(line) > 100:
        shown: list[str] = []
        keyword = False
        for parameter in kept:
            if parameter.kind is parameter.KEYWORD_ONLY and not keyword:
                shown, keyword = [*shown, "*"], True
            shown.append(_plain(parameter))
        rest = line[line.rindex(") ->") :] if ") ->" in line else ")"
        line = "\n".join([f"{name}(", *(f"    {each}," for each in shown), rest])
    return f"```text\n{line}\n```"


def _plain(signature: inspect.Signature | inspect.Parameter) -> str:
    """A signature in the names that a reader knows."""
    text = str(signature).replace(
        "bool | int | float | str | collections.abc.Sequence[bool | int | float | str]", "Value"
    )
    text = re.sub(r"(?:collections\.abc|typing|pidtsm_(?:core|studies)(?:\.\w+)*|numpy)\.", "", text)
    return text.replace("'", "").replace("ndarray[tuple[Any, ...], dtype[float64]]", "Array")


def _text(docstring: str) -> str:
    """A docstring as Markdown: its sections become lists."""
    lines: list[str] = []
    within = False  # a section
    for line in docstring.replace("``", "`").splitlines():
        if section := _SECTION.match(line):
            lines += [f"**{section[1]}**", ""]
            within = True
        elif within and (entry := _ENTRY.match(line)):
            lines.append(f"* `{entry[1]}`: {entry[2]}")
        else:
            # What continues an entry is indented twice; code outside of a section stays as it is.
            lines.append(re.sub("^ {8}", "  ", line).removeprefix("    ") if within else line)
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
