"""The Numba decorators of the whole package, with a cache that cannot go stale.

Numba caches a compiled function beside the *file it stands in*; an edit to a function it calls, in another
file, is not noticed. The cache therefore lives in a folder named after the content of every source file of
this package: any edit starts a fresh one.

The compiled code keeps IEEE semantics (no ``fastmath``): the same inputs give the same bits whether a
function is called from a node or inlined into a rollout.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

_KEPT_CACHES = 6

# Loops run over a handful of joints: to check whether they can be vectorised takes longer than that saves, by 4 % of a
# rollout.
numba.config.LOOP_VECTORIZE = 0


def _writable_root() -> Path:
    """Folder of our own for the caches: below NUMBA_CACHE_DIR, the user's cache folder, or a temporary one."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    fallback = Path(tempfile.gettempdir(), f"pidtsm-{os.getuid()}")
    for root in (Path(chosen, "pidtsm-numba"), fallback):
        try:
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError:
            continue
        # The cache holds code: it must be ours.
        if os.access(root, os.W_OK | os.X_OK) and root.stat().st_uid == os.getuid():
            return root
    return Path(tempfile.mkdtemp(prefix="pidtsm-numba-"))


def _source_digest() -> str:
    """Digest of every source file of this package."""
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parent
    for file in sorted(root.rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _age(folder: Path) -> float:
    try:
        return -folder.stat().st_mtime
    except OSError:  # Another process tidies up too.
        return 0.0


def _use_own_cache() -> None:
    root = _writable_root()
    folder = root / _source_digest()
    if not folder.exists():
        folder.mkdir(exist_ok=True)
        for stale in sorted(root.iterdir(), key=_age)[_KEPT_CACHES:]:
            shutil.rmtree(stale, ignore_errors=True)
    numba.config.CACHE_DIR = str(folder)


_use_own_cache()

_Function = TypeVar("_Function", bound=Callable[..., Any])

_OPTIONS = {"error_model": "numpy", "_nrt": False, "forceinline": True}


def njit(function: _Function) -> _Function:
    """Compile `function` to machine code on its first call, cached on disk, without the GIL.

    Division by zero gives inf or nan as in NumPy instead of raising, so guards stand where the mathematics
    needs them.

    Compiled code allocates nothing, so it need not count references to its arrays either (half of a tick's time):
    a function that makes an array, also as a whole assignment (``a[:] = b``; write the loop), does not compile.
    """
    return cast(_Function, numba.njit(cache=True, nogil=True, **_OPTIONS)(function))


def outlined(function: _Function) -> _Function:
    """As `njit`, but called from compiled code instead of inlined: for what is rare, so that the loop stays small."""
    return cast(_Function, numba.njit(cache=True, nogil=True, **{**_OPTIONS, "forceinline": False})(function))


def inlined(function: _Function) -> _Function:
    """Compile `function` into whatever compiled function calls it; called from Python it runs as Python.

    For what takes less time than a call into compiled code, which is up to a microsecond, and is needed on both sides.
    """
    return cast(_Function, register_jitable(**_OPTIONS)(function))
