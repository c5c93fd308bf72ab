"""`./pidtsm docs`: the documents as a site with search, which needs no network, neither while it is built nor shown.

Equations become MathML, diagrams are drawn by a script that the site contains, and examples are run for their pictures.
"""

import argparse
import functools
import http.server
import sys
import tempfile
import zipfile
from pathlib import Path

from distribution.pages import collect
from distribution.tools import ROOT, DistributionError, call, outside, tools

_SCRIPT = "mermaid.min.js"
"""Each site has it; MkDocs empties the folder of an earlier one."""


def main(arguments: list[str]) -> int:
    """Returns the exit code: 0 all is well, 1 the site cannot be built."""
    parser = argparse.ArgumentParser(prog="./pidtsm docs", description=__doc__.partition("\n\n")[2])
    parser.add_argument("--out", type=Path, default=ROOT / "site", metavar="DIR", help="default: site")
    parser.add_argument("--serve", action="store_true", help="then show it in the browser, until Ctrl-C")
    parser.add_argument("--port", type=int, default=8000, help="of --serve (default: 8000)")
    options = parser.parse_args(arguments)
    out = options.out.resolve()
    try:
        build(out)
    except DistributionError as error:
        print(f"pidtsm: {error}", file=sys.stderr)
        return 1
    print(f"{out / 'index.html'}")
    if options.serve:
        handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(out))
        with http.server.ThreadingHTTPServer(("127.0.0.1", options.port), handler) as server:
            print(f"http://127.0.0.1:{options.port}, until Ctrl-C", flush=True)
            server.serve_forever()
    return 0


def build(out: Path) -> None:
    """Build the site in a folder; any warning is an error.

    Raises:
        DistributionError: MkDocs warns or fails, an example fails, the tools cannot be installed, or the folder has
            something else, which must not be lost.
    """
    if out.exists() and not (out / _SCRIPT).exists() and (not out.is_dir() or any(out.iterdir())):
        raise DistributionError(f"{out} has something that is not of an earlier call: name an empty folder")
    programs = tools("docs")
    with tempfile.TemporaryDirectory() as text:
        pages = Path(text, "pages")
        collect(pages, programs)
        (pages / _SCRIPT).write_bytes(_mermaid())
        environment = {**outside(), "PIDTSM_PAGES": str(pages), "PIDTSM_SITE": str(out), "NO_MKDOCS_2_WARNING": "1"}
        call(programs / "mkdocs", "build", "--strict", environment=environment)  # --quiet would hide warnings from it.


def _mermaid() -> bytes:
    """The script that draws diagrams, out of the wheel that contains it."""
    folder = ROOT / ".venv" / "tools" / "mermaid"
    if not list(folder.glob("*.whl")):
        lock = ROOT / "requirements" / "mermaid.lock"
        options = ["--quiet", "--no-deps", "--ignore-requires-python", "--require-hashes", "-r", lock]
        call(sys.executable, "-m", "pip", "download", "--dest", folder, *options, environment=outside())
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        return wheel.read("artoo_mermaid/assets/mermaid.min.js")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
