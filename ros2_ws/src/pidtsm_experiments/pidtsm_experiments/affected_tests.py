"""Which tests a change of the checkout can break, by what imports what."""

import ast
import re
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

from pidtsm_core.errors import UsageError

_ROOTS = ("ros2_ws/src/*", "tests", "scripts", "benchmarks", "examples")
"""Folders below which the path of a file is its dotted name; the first that fits counts."""
_TEST = re.compile(r"(^|/)test_\w+\.py$")
_DOTTED = re.compile(r"\b[a-z]\w*(?:\.\w+)+")
_DEFINED = re.compile(r"^def ([a-z]\w*)", re.MULTILINE)
_COMMAND = ("pidtsm_experiments.cli", "launcher.install")
"""What `./pidtsm` runs."""
_ENTRY_POINTS = "pidtsm_ros/main.py"
"""The file that runs what the setup.py of the packages name."""


def changed_files(root: Path, since: str) -> list[str]:
    """Files that differ from a commit, those that git does not know included, relative to the checkout.

    Args:
        root: the checkout.
        since: a commit.

    Raises:
        UsageError: git does not know the commit, or this is no checkout of it.
    """

    def git(*words: str) -> list[str]:
        done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True)
        if done.returncode:
            raise UsageError(f"--changed {since}: {done.stderr.strip().splitlines()[-1]}")
        return [name for name in done.stdout.split("\0") if name]

    differing = git("diff", "--name-only", "--no-renames", "-z", since, "--")
    return sorted({*differing, *git("ls-files", "--others", "--exclude-standard", "-z")})


class Sources:
    """The Python files of a checkout, and which of them import which.

    A file depends on those that it imports or names, and on theirs. A file that is no module counts as a change of the
    files that name it or, in a package, of the modules beside it.

    Attributes:
        text: content by file, relative to the checkout.
    """

    def __init__(self, root: Path) -> None:
        """Read the checkout at `root`."""
        self.text: dict[str, str] = {}
        self._file_of: dict[str, str] = {}  # by dotted name
        for folder in (found for pattern in _ROOTS for found in sorted(root.glob(pattern)) if found.is_dir()):
            for file in sorted(folder.rglob("*.py")):
                name = file.relative_to(root).as_posix()
                if name not in self.text:
                    self.text[name] = file.read_text(encoding="utf-8")
                    dotted = ".".join(file.relative_to(folder).with_suffix("").parts)
                    self._file_of.setdefault(dotted.removesuffix(".__init__"), name)
        self._imports = {name: set(self._imported(name, text)) for name, text in self.text.items()}

    def tests(self, changed: Iterable[str]) -> list[str] | None:
        """Files of tests that a change can break, sorted.

        Args:
            changed: files, relative to the checkout.

        Returns:
            The files, relative to the checkout; None if nothing names a changed file, so that every test counts.
        """
        touched: set[str] = set()
        for name in changed:
            found = {name} if name in self.text else self._concerned_by(name)
            if not found:
                return None
            touched |= found
        return sorted(file for file in self._dependents(touched) if _TEST.search(file))

    def _imported(self, file: str, text: str) -> Iterator[str]:
        """Files that a module imports, anywhere, or names in a string, as it does for those loaded when needed."""
        names: list[str] = []
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                names += _DOTTED.findall(node.value)
            elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
                start = str(node.values[0].value)
                names += [name for name in self._file_of if "." in start and name.startswith(start)]
        if not file.startswith("ros2_ws/src/pidtsm_") or "/test/" in file:  # Others speak of commands to their users.
            names += _COMMAND if re.search(r"[\"/]pidtsm[\" ]", text) else ()
        if file.endswith(_ENTRY_POINTS):
            yield from (setup for setup in self.text if setup.endswith("/setup.py"))
        yield from (self._file_of[name] for name in names if name in self._file_of)
        yield from (conftest for conftest, fixtures in self._fixtures(file) if fixtures.search(text))

    def _fixtures(self, file: str) -> Iterator[tuple[str, re.Pattern[str]]]:
        """Each conftest.py that counts for a file, and the names of what it defines."""
        for conftest in (f"{folder.as_posix()}/conftest.py" for folder in Path(file).parents):
            names = _DEFINED.findall(self.text.get(conftest, "")) if conftest != file else []
            if names:
                yield conftest, re.compile(rf"\b({'|'.join(names)})\b")

    def _concerned_by(self, name: str) -> set[str]:
        """Files that name a file which is no module, or else those of the package that it is in."""
        path = Path(name)
        top = path.parts[0]
        words = {path.name, path.stem} if top == "ros2_ws" else {path.name, f'"{top}"', f'"{top}/', f"/{top}/"}
        naming = {file for file, text in self.text.items() if any(word in text for word in words)}
        beside = {file for file in self.text for folder in path.parents[:-1] if Path(file).parent == folder}
        return naming or beside

    def _dependents(self, files: set[str]) -> set[str]:
        """These files, and all that import them, directly or not."""
        found, new = set(files), set(files)
        while new:
            new = {file for file, imported in self._imports.items() if imported & new} - found
            found |= new
        return found
