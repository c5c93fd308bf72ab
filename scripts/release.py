"""`./pidtsm release`: the files of a release, each checked as its user would meet it.

Writes the wheel and its source archive, the ROS packages as a source archive, a bill of materials (CycloneDX) and
checksums.
"""

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from distribution.audit import audit
from distribution.ros_packages import archive
from distribution.tools import (
    ROOT,
    SUPPORTED,
    DistributionError,
    call,
    emptied,
    make_environment,
    outside,
    pythons,
    tools,
)
from distribution.version import find_differences, version

FILES = r"pidtsm-.*\.(whl|tar\.gz|cdx\.json)|SHA256SUMS"
"""Fits the names of the files that it writes."""
_UNFIT = ".example"
"""Ends addresses that nobody has."""


def main(arguments: list[str]) -> int:
    """Returns the exit code: 0 all is well, 1 a step failed."""
    parser = argparse.ArgumentParser(prog="./pidtsm release", description=__doc__.partition("\n\n")[2])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", metavar="DIR", help="default: dist")
    parser.add_argument("--python", action="append", metavar="X.Y", help="try it with this one only; can be repeated")
    parser.add_argument("--quick", action="store_true", help="a short trial with every Python, without a long one")
    options = parser.parse_args(arguments)
    try:
        _release(options.out.resolve(), options.python, options.quick)
    except DistributionError as error:
        print(f"pidtsm: {error}", file=sys.stderr)
        return 1
    return 0


def _release(out: Path, wanted: list[str] | None, quick: bool) -> None:
    """Do all steps, also those after one that fails, and tell what could not be tried.

    Raises:
        DistributionError: nothing can be released, or steps have failed; their texts are shown by then.
    """
    if differing := find_differences(ROOT):
        raise DistributionError(f"the version is {version(ROOT)}, but not in {', '.join(differing)}")
    known = pythons()
    if missing := set(wanted or ()) - known.keys():
        raise DistributionError(f"no Python {', '.join(sorted(missing))} here; found: {', '.join(known)}")
    wheel = build(emptied(out, FILES))
    chosen = wanted or list(known)
    steps: dict[str, Callable[[], str]] = {
        "the audit": lambda: audit(ROOT / "requirements" / "wheels.lock", tools("release")),
        "the ROS packages": lambda: archive(out / f"pidtsm-ros-{version(ROOT)}.tar.gz"),
    }
    for each in chosen:
        bill = out / f"pidtsm-{version(ROOT)}.cdx.json" if each == chosen[-1] else None
        short = quick or each != chosen[-1]
        steps[f"Python {each}"] = partial(_try, wheel, each, known[each], bill, short=short)
    failed = run(steps)
    if untried := [] if wanted else [each for each in SUPPORTED if each not in known]:
        _say(f"not tried: Python {', '.join(untried)}, which this machine does not have")
    if failed:
        raise DistributionError(f"no release, {len(failed)} of {len(steps)} steps failed: {', '.join(failed)}")
    files = sorted(out.iterdir())
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files]
    (out / "SHA256SUMS").write_text("".join(sums), "utf-8")
    print("".join(sums), end="")
    if any(_UNFIT in file.read_text("utf-8") for file in ROOT.glob("ros2_ws/src/*/package.xml")):
        _say("before it is published: package.xml needs the maintainers' address, pyproject.toml the project's URL")


def run(steps: Mapping[str, Callable[[], str]]) -> list[str]:
    """Do all steps, each of which returns a sentence to be shown, and return the names of those that failed."""
    failed = []
    for name, step in steps.items():
        _say(f"{name} ...")
        try:
            _say(step())
        except DistributionError as error:
            _say(f"{name} failed: {error}")
            failed.append(name)
    return failed


def build(out: Path) -> Path:
    """Build the source archive and, from it, the wheel, in an empty folder (see `emptied`); returns the wheel.

    Raises:
        DistributionError: a build or a check of its metadata fails.
    """
    programs = tools("release")
    built = call(programs / "python", "-m", "build", "--no-isolation", "--outdir", out, environment=outside())
    _say(built.splitlines()[-1])
    files = sorted(out.iterdir())
    call(programs / "twine", "check", "--strict", *files, environment=outside())
    _say("twine check --strict: passed")
    return next(file for file in files if file.suffix == ".whl")


def _try(wheel: Path, name: str, python: Path, bill: Path | None, *, short: bool) -> str:
    """Install the wheel in an empty environment and use it; write what it brings along to a file `bill`.

    Returns:
        A sentence with the processor times.

    Raises:
        DistributionError: something fails.
    """
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        installed = make_environment(python, folder / "venv", "--compile-bytecode", wheel)  # as pip does
        if bill:
            words = [tools("release") / "cyclonedx-py", "environment", installed, "--output-reproducible", "-o", bill]
            call(*words, environment=outside())
        (folder / "empty").mkdir()
        smoke = ROOT / "scripts" / "distribution" / "smoke.py"
        words = [installed, smoke, ROOT / "README.md", *(["--short"] if short else [])]
        times = json.loads(call(*words, environment=outside(), cwd=folder / "empty").splitlines()[-1])
    shown = ", ".join(f"{command} {seconds} s" for command, seconds in times.items())
    return f"Python {name}, processor times: {shown}"


def _say(text: str) -> None:
    print(f"pidtsm: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
