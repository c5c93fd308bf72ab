"""The Numba decorators of the whole package, with options and a cache of their own.

Nothing of Numba's is changed for other functions of the process: the options that are no arguments of Numba's
decorators hold while a function of this package is compiled, and are put back afterwards.

Numba's cache detects an edit only in the *file of the compiled function*, not in the files of the functions that it
calls. Therefore the name of the cache folder is a digest of all source files of this package: any edit starts a new
cache.

The compiled code keeps IEEE semantics (no ``fastmath``): the same inputs give the same bits whether a
function is called from a node or inlined into a rollout.
"""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

from pidtsm_core.compiling.events import OWN_OPTIONS

_KEPT_CACHES = 6
_UNUSED = 3600.0
"""s; a cache that was used since then is kept, because a process of another checkout may be filling it."""


def _writable_root() -> Path:
    """The package's own folder for caches: below NUMBA_CACHE_DIR, the user's cache folder, or a temporary folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    fallback = Path(tempfile.gettempdir(), f"pidtsm-{os.getuid()}")
    for root in (Path(chosen, "pidtsm-numba"), fallback):
        try:
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError:
            continue
        # The cache contains code, so it must belong to this user.
        if os.access(root, os.W_OK | os.X_OK) and root.stat().st_uid == os.getuid():
            return root
    return Path(tempfile.mkdtemp(prefix="pidtsm-numba-"))


def _source_digest() -> str:
    """Digest of every source file of this package."""
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parents[1]
    for file in sorted(root.rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _age(folder: Path) -> float:
    """Time since a cache was last used, s."""
    try:
        return time.time() - folder.stat().st_mtime
    except OSError:  # Another process may have removed it.
        return 0.0


@cache
def cache_folder() -> Path:
    """Where the compiled functions of this package are stored; its name is a digest of all source files."""
    root = _writable_root()
    folder = root / _source_digest()
    if folder.exists():
        with suppress(OSError):  # It is another user's, or was just removed.
            os.utime(folder)
    else:
        folder.mkdir(exist_ok=True)
        for stale in sorted(root.iterdir(), key=_age)[_KEPT_CACHES:]:
            if _age(stale) > _UNUSED:
                shutil.rmtree(stale, ignore_errors=True)
    return folder


_Function = TypeVar("_Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "forceinline": True, "nogil": True}
INSIDE: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""For functions that only compiled code calls: without wrappers for Python, they compile in 2/3 of the time."""


def compiled(function: _Function, *signature: Any, stored: bool = True, **options: Any) -> Any:
    """Compile `function` as `njit` does, but with other options, and now if there is a signature."""
    OWN_OPTIONS.functions.add(function.__code__)
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(cache_folder())
    try:
        return numba.njit(*signature, cache=stored, **options)(function)
    finally:
        numba.config.CACHE_DIR = before


def njit(function: _Function) -> _Function:
    """Compile `function` to machine code on its first call, cached on disk, without the GIL.

    Division by zero gives inf or nan as in NumPy and raises nothing, so the code has guards where the mathematics
    needs them.

    Compiled code allocates nothing, so it does not count references to its arrays either, which saves half of a tick's
    time. A function that creates an array does not compile; this includes whole assignments (``a[:] = b``), so write
    a loop instead.
    """
    return cast(_Function, compiled(function, **_OPTIONS))


def subroutine(function: _Function) -> _Function:
    """As `njit`, but compiled code calls it instead of inlining it: for long functions."""
    return cast(_Function, compiled(function, **{**_OPTIONS, "forceinline": False}))


_INLINED: set[Callable[..., Any]] = set()
"""The functions that `inlined` was given."""


def inlined(function: _Function) -> _Function:
    """Compile `function` into each compiled function that calls it; called from Python, it runs as Python.

    It is not stored, because its callers are.
    """
    OWN_OPTIONS.functions.add(function.__code__)
    _INLINED.add(function)
    return cast(_Function, register_jitable(**INSIDE)(function))


def callable_inside(function: _Function) -> _Function:
    """The function as compiled code can call it: a Python function is `inlined`, one of Numba's stays as it is."""
    if hasattr(function, "py_func") or function in _INLINED:
        return function
    return inlined(function)


def is_own(function: Any) -> bool:
    """Whether a function and those in its closure are of this package.

    Others are not stored: an edit of a file that they use would go unnoticed.
    """
    function = getattr(function, "py_func", function)
    held = [cell.cell_contents for cell in function.__closure__ or ()]
    inside = [each for each in held if isinstance(each, FunctionType) or hasattr(each, "py_func")]
    return str(function.__module__).partition(".")[0] == __name__.partition(".")[0] and all(map(is_own, inside))


_Result = TypeVar("_Result")


def dispatch(functions: Iterable[Callable[..., _Result]]) -> Callable[..., _Result]:
    """Combine the functions of all members into one, which compiled code calls as ``call(index, *arguments)``.

    Numba cannot inline functions from a table. Therefore this is a chain of comparisons with the members' functions
    inlined.

    Args:
        functions: compiled, at least one, in the order of the members, with the same arguments and results. An index
            beyond the last counts as the last.
    """
    first, *others = functions
    if not others:

        @inlined
        def last(_index: int, *arguments: Any) -> _Result:
            return first(*arguments)

        return last

    rest = dispatch(others)

    @inlined
    def call(index: int, *arguments: Any) -> _Result:
        return first(*arguments) if index == 0 else rest(index - 1, *arguments)

    return call
