"""`./pidtsm bundle`: a folder that installs pidtsm on a machine without network and without a compiler.

It holds the wheel, all that it needs for one version of Python, their checksums, and `install.sh`.
"""

import argparse
import hashlib
import platform
import shutil
import sys
from pathlib import Path

from distribution.tools import ROOT, DistributionError, call, emptied, outside, pythons
from release import FILES, build

_INSTALL = """#!/bin/sh
# Installs pidtsm from this folder, without network: sh install.sh [FOLDER of the environment, default: pidtsm-env]
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
target=${1:-pidtsm-env}
python=${PIDTSM_PYTHON:-python@VERSION@}
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (@NUMBERS@))' ||
    { echo "install.sh: needs Python @VERSION@: install it, or name it with PIDTSM_PYTHON" >&2; exit 1; }
(cd "$here" && sha256sum --check --quiet SHA256SUMS)
"$python" -m venv "$target"
"$target/bin/python" -m pip install --quiet --no-index --find-links "$here/wheels" pidtsm
echo "installed: $target/bin/pidtsm --help"
"""


def main(arguments: list[str]) -> int:
    """Returns the exit code: 0 all is well, 1 a step failed."""
    parser = argparse.ArgumentParser(prog="./pidtsm bundle", description=__doc__.partition("\n\n")[2])
    default = f"{sys.version_info.major}.{sys.version_info.minor}"
    parser.add_argument("--python", default=default, metavar="X.Y", help=f"of the other machine (default: {default})")
    parser.add_argument("--out", type=Path, default=ROOT / "bundle", metavar="DIR", help="default: bundle")
    options = parser.parse_args(arguments)
    try:
        _bundle(options.out.resolve(), options.python)
    except DistributionError as error:
        print(f"pidtsm: {error}", file=sys.stderr)
        return 1
    return 0


def _bundle(out: Path, version: str) -> None:
    known = pythons()
    if version not in known:
        raise DistributionError(f"no Python {version} here, to choose its wheels; found: {', '.join(known)}")
    wheel = build(emptied(out, rf"{FILES}|wheels|install\.sh|LICENSE"))
    wheels = out / "wheels"
    for file in out.glob("*.tar.gz"):
        file.unlink()
    words = ["-m", "pip", "download", "--quiet", "--only-binary=:all:", "--dest", wheels, wheel]
    call(known[version], *words, environment=outside())
    wheel.unlink()  # pip has copied it.
    script = _INSTALL.replace("@VERSION@", version).replace("@NUMBERS@", version.replace(".", ", "))
    (out / "install.sh").write_text(script, "utf-8")
    (out / "install.sh").chmod(0o755)
    shutil.copy(ROOT / "LICENSE", out)
    files = sorted(file for file in out.rglob("*") if file.is_file())
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.relative_to(out)}\n" for file in files]
    (out / "SHA256SUMS").write_text("".join(sums), "utf-8")
    size = sum(file.stat().st_size for file in files) / 1e6
    print(f"{out}: {len(files)} files, {size:.0f} MB, for Python {version} on {platform.system()} {platform.machine()}")
    print("there: sh install.sh [FOLDER]")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
