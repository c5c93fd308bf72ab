"""``./pidtsm new``: the files of a law, or of another member, of one's own."""

import argparse
import keyword
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from pidtsm_core.errors import UsageError
from pidtsm_core.registration import FAMILIES


class _Kind(NamedTuple):
    family: str
    title: str
    use: str  # how a rollout chooses it


_KINDS = {
    "law": _Kind("laws", "law", "--law {}"),
    "surface": _Kind("surfaces", "sliding surface", "--law sliding_mode --set controller.law.surface={}"),
    "reaching": _Kind("reaching", "reaching law", "--law sliding_mode --set controller.law.reaching={}"),
    "reference": _Kind("references", "reference", "--set trajectory.reference.name={}"),
    "disturbance": _Kind("disturbances", "disturbance", "--set simulator.disturbance.name={}"),
}
_EPILOG = """It writes a folder with a Python package: a formula that works, and a test of it. Change the formula and
install the folder; then every command and node knows the name.

examples:
  ./pidtsm new law my_law
  ./pidtsm shell -c "python -m pytest my_law"
  ./pidtsm shell -c "python -m pip install --no-build-isolation -e ./my_law"
  ./pidtsm rollout --law my_law
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("kind", choices=tuple(_KINDS), metavar="KIND", help=f"one of {', '.join(_KINDS)}")
    parser.add_argument("name", metavar="NAME", help="how users choose it: letters, digits and underscores")
    parser.add_argument(
        "--folder", type=Path, default=Path(), metavar="DIR", help="where to put the folder NAME (default: here)"
    )


def execute(options: argparse.Namespace) -> int:
    kind, name = _KINDS[options.kind], options.name
    if not name.isidentifier() or keyword.iskeyword(name) or not name.isascii() or name != name.lower():
        raise UsageError(f"{name}: the name must consist of small letters, digits and underscores, and be no keyword")
    if name in next(family for family in FAMILIES if family.title == kind.family):
        raise UsageError(f"{name}: there is a {kind.title} of this name already; choose another one")
    folder = options.folder / name
    if folder.exists():
        raise UsageError(f"{folder} exists; choose another name, or another --folder")
    files = _files(options.kind, name)
    folder.mkdir(parents=True)
    for file, content in files.items():
        (folder / file).write_text(content, encoding="utf-8")
    print(f"{folder}: {', '.join(files)}")
    print(f'install it:  ./pidtsm shell -c "python -m pip install --no-build-isolation -e {folder.resolve()}"')
    print(f"try it:      ./pidtsm rollout {kind.use.format(name)}")
    return 0


def _files(kind: str, name: str) -> dict[str, str]:
    """Content of the files of a new member, by name."""
    templates = Environment(
        loader=PackageLoader("pidtsm_experiments", "templates/members"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 - Python, not HTML.
    )
    given = {"kind": kind, "name": name, "member": name.upper(), "family": _KINDS[kind].family}
    names = {f"{name}.py": f"{kind}.py", f"test_{name}.py": "test.py", "pyproject.toml": "pyproject.toml"}
    return {
        file: templates.get_template(f"{source}.jinja").render(**given, title=_KINDS[kind].title)
        for file, source in names.items()
    }
