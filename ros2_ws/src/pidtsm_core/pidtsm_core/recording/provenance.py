"""What a result depends on apart from its parameters: version and commit, libraries, processor, mathematics."""

import functools
import hashlib
import math
import os
import platform
import struct
import subprocess
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import pidtsm_core

_SOURCE = Path(pidtsm_core.__file__).resolve().parent
_ANSWER_WITHIN = 5.0  # s
LIBRARIES = ("numpy", "numba", "llvmlite", "mujoco")
"""Those that compute, or compile what computes; the last one only for its engine."""
_FEATURES = ("avx", "avx2", "avx512f", "fma", "neon", "sve")
"""Of processors, as far as compilers and C libraries choose among them how to compute."""
_FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": lambda x: math.exp(x / 9.0),
    "log": math.log,
    "pow": lambda x: math.pow(x, 0.6),
    "tanh": lambda x: math.tanh(x / 9.0),
    "atan2": lambda x: math.atan2(x, 2.0),
}
_POINTS = 500
"""Number of arguments that tell the functions of two C libraries apart."""


def commit(source: Path = _SOURCE) -> str | None:
    """The commit of the source, with ``+changes`` if files differ from it; None if it is not in a git repository.

    Args:
        source: folder of the package.
    """
    if not _git(source, "ls-files", "--error-unmatch", "__init__.py"):
        return None  # Installed, perhaps in the repository of somebody else.
    head = _git(source, "rev-parse", "HEAD")
    changed = head and _git(source, "status", "--porcelain", "--untracked-files=no")
    return head + "+changes" if changed else head or None


@functools.cache
def commit_at_start() -> str | None:
    """What `commit` was when it was asked for first: the source that this process has imported, or nearly so."""
    return commit()


@functools.cache
def environment() -> dict[str, Any]:
    """What decides about the last bits of a result, beside the source and the parameters.

    Returns:
        ``python``, the `LIBRARIES` (None: not installed) and ``libc``: versions. ``processor``: its name; ``machine``:
        its architecture; ``target``: what the compiler takes it for; ``features``: those that compilers and C libraries
        choose by, such as ``fma``. ``mathematics``: digest of what functions of the C library give, by name.
    """
    target, features = _target()
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
        "libc": _libc(),
        "machine": platform.machine(),
        "processor": _processor(),
        "target": target,
        "features": features,
        "mathematics": {name: _digest(function) for name, function in _FUNCTIONS.items()},
    }


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def _libc() -> str:
    with suppress(AttributeError, OSError, ValueError):
        return os.confstr("CS_GNU_LIBC_VERSION") or ""
    return " ".join(platform.libc_ver())


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() in ("model name", "Model"):
                return value.strip()
    return platform.processor()


def _target() -> tuple[str, list[str]]:
    """The processor that Numba compiles for, and its features."""
    import llvmlite.binding as llvm  # The compiler is slow to import.
    import numba

    known = {name for name, has in llvm.get_host_cpu_features().items() if has}
    if chosen := numba.config.CPU_FEATURES:
        words = chosen.split(",")
        known = {word[1:] for word in words if word.startswith("+")}
    elif numba.config.CPU_NAME == "generic":
        known = set()
    return numba.config.CPU_NAME or llvm.get_host_cpu_name(), [name for name in _FEATURES if name in known]


def _digest(function: Callable[[float], float]) -> str:
    values = [function(0.01 + 0.0618034 * k) for k in range(_POINTS)]
    return hashlib.sha256(struct.pack(f"<{_POINTS}d", *values)).hexdigest()[:8]


def _git(source: Path, *words: str) -> str:
    """What git prints about the source; empty if it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(source), *words], capture_output=True, text=True, timeout=_ANSWER_WITHIN, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
