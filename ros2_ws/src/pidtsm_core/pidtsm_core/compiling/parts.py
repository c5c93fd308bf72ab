"""Parts: functions that are compiled on their own, when they are first needed, and called by address.

Numba copies a function into every function that calls it, and compiles all of them before the first call. A part is
compiled once, and only if a call reaches it: the law that was chosen, the stop that happened. Compiled code finds its
address in a table at a symbol whose name does not change, so that Numba can store the calling function.
"""

import ctypes
import threading
import traceback
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType
from typing import Any, ClassVar, TypeVar, get_type_hints

from llvmlite import binding, ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.types.containers import UniTuple
from numba.core.types.misc import VarArg
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import lower_builtin

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import INSIDE, compiled
from pidtsm_core.compiling.pointers import Pointer

FLOAT, INTEGER, ROW, ROWS = types.float64, types.int64, types.float64[::1], types.float64[:, ::1]
"""Numba's types for signatures; an array of numbers has one dimension (`ROW`) or two (`ROWS`)."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
_WORD = ir.IntType(64)
_PREPARE = "pidtsm_core.compiling.parts.prepare"
_PREPARE_TYPE = ir.FunctionType(_WORD, [_WORD, _WORD])


class PartError(RuntimeError):
    """A part could not be compiled; its caller has ended early."""


_FAILED = "a function of pidtsm could not be compiled: the reason is on standard error"
_ATTEMPTS = 3
"""Ctrl-C cannot pass through compiled code, so a compilation that it has interrupted begins again."""


class _Parts:
    """Parts with one signature, by index."""

    tables: ClassVar[dict[int, "_Parts"]] = {}
    """All of them, by the address of their table."""
    lock = threading.RLock()

    def __init__(self, functions: Iterable[Callable[..., Any]], signature: Callable[[], Any]) -> None:
        """Reserve the table; nothing is compiled. See `by_index`."""
        self.functions = [getattr(function, "py_func", function) for function in functions]
        self.signature = signature
        self._compiled: list[Any] = []
        self._table = (ctypes.c_int64 * len(self.functions))()
        first = self.functions[0]
        self._symbol = f"{first.__module__}.{first.__qualname__}.{len(self.functions)}"
        binding.add_symbol(self._symbol, ctypes.addressof(self._table))
        self.tables[ctypes.addressof(self._table)] = self

    def prepare(self, index: int = 0) -> None:
        """Compile the part at `index`, or load it from the cache, unless that has happened."""
        with self.lock:
            if not self._table[index]:
                part = compiled(_renamed(self.functions[index]), self.signature(), **INSIDE)
                (result,) = part.overloads.values()
                self._compiled.append(part)
                self._table[index] = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)

    def lower(self, context: Any, builder: Any, index: Any, arguments: Any) -> Any:
        """Generate the call of the part at `index`."""
        table = builder.module.globals.get(self._symbol) or ir.GlobalVariable(
            builder.module, ir.ArrayType(_WORD, len(self.functions)), self._symbol
        )
        place = builder.gep(table, [_WORD(0), index], inbounds=True)
        signature, convention = self.signature(), context.call_conv
        with builder.if_then(builder.icmp_unsigned("==", builder.load(place), _WORD(0)), likely=False):
            prepare = cgutils.get_or_insert_function(builder.module, _PREPARE_TYPE, _PREPARE)
            failed = builder.call(prepare, [builder.ptrtoint(table, _WORD), index])
            with builder.if_then(builder.icmp_unsigned("!=", failed, _WORD(0)), likely=False):
                convention.return_user_exc(builder, PartError, (_FAILED,))
        kind = convention.get_function_type(signature.return_type, signature.args)
        part = builder.inttoptr(builder.load(place), kind.as_pointer())
        status, result = convention.call_function(builder, part, signature.return_type, signature.args, arguments)
        with cgutils.if_unlikely(builder, status.is_error):  # A part of this part.
            convention.return_status_propagate(builder, status)
        return result

    def make_callable(self, function: Any, indexed: bool) -> None:
        """Make compiled code that calls the Python function `function` call the parts, the index first if `indexed`."""
        parts = self

        class Template(AbstractTemplate):
            key = function

            def generic(self, given: Any, keywords: Any) -> Any:
                signature = parts.signature()
                arguments = (INTEGER, *signature.args) if indexed else signature.args
                fits = len(given) == len(arguments) and not keywords
                return signature.replace(args=arguments) if fits else None

        infer_global(function, types.Function(Template))

        @lower_builtin(function, VarArg(types.Any))
        def lower(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            index, passed = (arguments[0], arguments[1:]) if indexed else (_WORD(0), arguments)
            return parts.lower(context, builder, index, passed)


def _renamed(function: Any) -> Any:
    """The same function under another name: Numba stores functions by name, and callers may contain this one too."""
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__module__, copy.__qualname__ = function.__module__, f"{function.__qualname__}.part"
    return copy


@ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
def _prepare(table: int, index: int) -> int:
    """Called by compiled code that needs a part; return 1 if there is none, for which it raises a `PartError`."""
    for _ in range(_ATTEMPTS):
        try:
            _Parts.tables[table].prepare(index)
        except KeyboardInterrupt:
            continue
        except Exception:  # It cannot pass through compiled code.
            traceback.print_exc()
            return 1
        return 0
    return 1


binding.add_symbol(_PREPARE, ctypes.cast(_prepare, ctypes.c_void_p).value)


def by_index(functions: Iterable[Callable[..., Any]], signature: Any) -> Any:
    """Combine functions into one that compiled code calls as ``call(index, *arguments)``; each of them is a part.

    Its attribute ``prepare(index)`` compiles a part, so that errors appear in Python.

    Args:
        functions: Python functions or Numba's dispatchers, in the order of their indices, at least one.
        signature: their common signature, as Numba has it.
    """
    parts = _Parts(functions, lambda: signature)

    def call(index: int, *arguments: Any) -> Any:
        return parts.functions[index](*arguments)

    call.prepare = parts.prepare  # type: ignore[attr-defined]
    parts.make_callable(call, indexed=True)
    return call


_KINDS = {
    int: INTEGER,
    float: FLOAT,
    bool: types.boolean,
    type(None): types.none,
    Array: ROW,
    tuple[float, float]: UniTuple(FLOAT, 2),
}
"""Numba's types by annotation; an array has one dimension."""


class PartOf:
    """A decorator that makes a function a part; from Python, it runs as Python."""

    def __init__(self, *make_examples: Callable[[], Any]) -> None:
        """Args: make_examples: return an example of each named tuple among the arguments, which are pointers."""
        self._make_examples = make_examples
        self._parts: list[_Parts] = []

    def __call__(self, function: _Function) -> _Function:
        parts = _Parts([function], lambda: self._signature(function))
        parts.make_callable(function, indexed=False)
        self._parts.append(parts)
        return function

    def _signature(self, function: Any) -> Any:
        examples = [make() for make in self._make_examples]
        kinds: Mapping[Any, Any] = {**_KINDS, **{type(e): Pointer(typeof(e)) for e in examples}}
        hints = get_type_hints(function)
        result = kinds[hints.pop("return")]
        return result(*(kinds[hint] for hint in hints.values()))

    def prepare(self) -> None:
        """Compile every part, for a caller that must not wait later."""
        for parts in self._parts:
            parts.prepare()
