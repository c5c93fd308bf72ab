"""Collects the pages of the site in one folder: the documents, those at the top of the checkout, and the examples."""

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from distribution.notebooks import execute
from distribution.outputs import kept
from distribution.tools import ROOT, DistributionError

_TOP = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Documents at the top of the checkout, and their pages. The list of all pages makes room for the first one."""
_PAGES = "pages.md"
_SHOWN = (".py", ".ipynb")
"""Ends of the names of examples."""
_LINK = re.compile(r"(\]\()([^)#\s:]+)((?:#[^)\s]*)?\))")
_FOR_TESTS = re.compile(r"^(```\w+) (?:example|fails)$", re.MULTILINE)
"""Words after a fence that only the tests read."""
_BOOSTS = {
    "decisions/": 0.1,
    "files/": 0.1,
    "changelog.md": 0.1,
    "leaderboard.md": 0.2,
    "tournament.md": 0.2,
    "api.md": 0.3,
    "reference.md": 0.3,
    "pages.md": 0.5,
    "topics.md": 0.5,
    "glossary.md": 0.5,
    "arms.md": 0.5,
    "performance.md": 0.5,
    "examples/": 0.6,
}
"""How much a page counts in a search, by the start of its name: what to do comes before lists and the past."""
_DRAWS = "savefig("
"""In an example whose picture its page shows."""


def collect(folder: Path, programs: Path) -> None:
    """Fill an empty folder with all pages; `programs` has the tools that run notebooks.

    Raises:
        DistributionError: an example fails.
    """
    shutil.copytree(ROOT / "docs", folder, dirs_exist_ok=True)
    (folder / "index.md").rename(folder / _PAGES)
    for document, place in _TOP.items():
        shutil.copy(ROOT / document, folder / place)
    shutil.copy(ROOT / "LICENSE", folder)
    _write_examples(folder / "examples", programs)
    sources = {place: ROOT / document for document, place in _TOP.items()} | {_PAGES: ROOT / "docs" / "index.md"}
    for page in sorted(folder.rglob("*.md")):
        name = str(page.relative_to(folder))
        if name.startswith("examples/"):
            source, text = ROOT / name, page.read_text("utf-8")
        else:
            source = sources.get(name, ROOT / "docs" / name)
            text = source.read_text("utf-8")
        page.write_text(_head(name) + _with_links(text, source, page, folder), "utf-8")


def _head(name: str) -> str:
    """What the search needs to know of a page."""
    boost = next((value for start, value in _BOOSTS.items() if name.startswith(start)), None)
    return f"---\nsearch:\n  boost: {boost}\n---\n" if boost else ""


def _with_links(text: str, source: Path, page: Path, folder: Path) -> str:
    """The text of a document with the links that lead somewhere in the site; other folders have no page there."""

    def moved(found: "re.Match[str]") -> str:
        target = (source.parent / found[2]).resolve()
        place = _place(target)
        if place is None:
            return found[0]
        if not place:
            return "](" + os.path.relpath(folder / _PAGES, page.parent) + ")"
        if target.is_file() and not (folder / place).exists():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(target, folder / place)
        return found[1] + os.path.relpath(folder / place, page.parent) + found[3]

    return _LINK.sub(moved, _FOR_TESTS.sub(r"\1", text))


def _place(target: Path) -> str | None:
    """Where a file of the checkout is in the site; empty: nowhere; None: the link leads to no file."""
    if not target.exists() or not target.is_relative_to(ROOT):
        return None
    name = str(target.relative_to(ROOT))
    known = {**_TOP, "docs/index.md": _PAGES, "examples": "examples/index.md"}
    if name in known or target.is_dir():
        return known.get(name, "")
    if name.startswith("examples/") and target.suffix in _SHOWN:
        return str(Path(name).with_suffix(".md"))
    return name.removeprefix("docs/") if name.startswith("docs/") else f"files/{name}"


def _write_examples(folder: Path, programs: Path) -> None:
    folder.mkdir()
    files = sorted(file for file in (ROOT / "examples").glob("*.*") if file.suffix in _SHOWN)
    drawn = [file for file in files if _draws(file)]
    with ThreadPoolExecutor(1) as pool:
        executed = pool.submit(execute, [file for file in files if file.suffix == ".ipynb"], programs, folder)
        kept("pictures", drawn, programs, folder, lambda made: _draw(drawn, made))
    executed.result()
    rows = []
    for file in files:
        if file.suffix == ".ipynb":
            about, body = _notebook((folder / f"{file.stem}.md").read_text("utf-8"))
            pictures = sorted(folder.glob(f"{file.stem}_files/*.png"))
            picture, shown = (f"{file.stem}_files/{pictures[0].name}" if pictures else None), ""
        else:
            about, body = _script(file.read_text("utf-8"))
            picture = f"{file.stem}.png" if file in drawn else None
            shown = f"\n![What it draws]({picture})\n" if picture else ""
        (folder / f"{file.stem}.md").write_text(f"# {file.name}\n\n{about}\n{shown}\n{body}", "utf-8")
        small = f"![{file.stem}]({picture}){{ width=240 }}" if picture else ""
        sentence = about.partition("\n\n")[0].partition(". ")[0].replace("\n", " ")
        rows.append(f"| [{file.name}]({file.stem}.md) | {sentence} | {small} |\n")
    head = "# Examples\n\n| example | what it shows | |\n| --- | --- | --- |\n"
    (folder / "index.md").write_text(head + "".join(rows), "utf-8")


def _draws(file: Path) -> bool:
    """Whether an example is a script that leaves a picture without being given a bag."""
    text = file.read_text("utf-8")
    return file.suffix == ".py" and _DRAWS in text and "sys.argv" not in text


def _script(text: str) -> tuple[str, str]:
    about = ast.get_docstring(ast.parse(text)) or ""
    return about, f"```python\n{text}```\n"


def _notebook(text: str) -> tuple[str, str]:
    """The first paragraph of a notebook that was run, and the rest without its title."""
    about, _, body = re.sub(r"^\s*# .*\n+", "", text).partition("\n\n")
    return about, re.sub(r"^# (?=[A-Z])", "## ", body) + "\n"


def _draw(files: Sequence[Path], folder: Path) -> None:
    """Leave the picture of each example in a new folder.

    Raises:
        DistributionError: one fails, or leaves no picture.
    """
    folder.mkdir()
    # Each is a process of its own.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda file: _picture(file, folder), files))


def _picture(file: Path, folder: Path) -> None:
    """Run an example where it may leave its picture.

    Raises:
        DistributionError: it fails, or leaves none.
    """
    place = folder / f"{file.stem}-files"
    place.mkdir()
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, file], cwd=place, env=environment, capture_output=True, text=True)
    pictures = sorted(place.rglob("*.png"))
    if done.returncode or not pictures:
        raise DistributionError(f"{file.name} left no picture:\n{done.stdout}{done.stderr}")
    pictures[0].replace(folder / f"{file.stem}.png")
    shutil.rmtree(place)
