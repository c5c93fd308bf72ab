"""What compiled code finds by address: named tuples, and functions that are compiled on their own.

Numba passes a named tuple by value: as hundreds of values for one that contains dozens of arrays, which LLVM takes
seconds to compile and every call takes time to copy. A pointer is one number, with the same attributes.

Numba copies a function into every function that calls it, and compiles all of them before the first call. A function
that parameters choose is compiled alone, when it is chosen; its address stands in the configuration, see `Interface`.
A part is compiled alone, when the first call reaches it, see `PartOf`.
"""

import ctypes
import hashlib
import threading
import traceback
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from types import FunctionType
from typing import Any, ClassVar, TypeVar, get_type_hints

import numba
from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.core.types.containers import BaseNamedTuple, UniTuple
from numba.core.types.misc import VarArg
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global
from numba.extending import infer_getattr, intrinsic, lower_builtin, lower_getattr_generic, models, register_model
from numba.np.arrayobj import make_array

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import INSIDE, compiled, is_own

FLOAT, INTEGER, ROW, ROWS = types.float64, types.int64, types.float64[::1], types.float64[:, ::1]
"""Numba's types for signatures; an array of numbers has one dimension (`ROW`) or two (`ROWS`)."""
INTEGERS, NOTHING, POINTER = types.int64[::1], types.none, numba.types.CPointer(types.float64)

_Tuple = TypeVar("_Tuple")
_Function = TypeVar("_Function", bound=Callable[..., Any])
_WORD = ir.IntType(64)


def tuple_of(kind: Any, length: int) -> Any:
    """Numba's type of a tuple of `length` values of one type."""
    return UniTuple(kind, length)


class Pointer(types.Type):
    """The type of a pointer to the named tuple of type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        digest = hashlib.sha256(str(dtype).encode()).hexdigest()[:12]
        super().__init__(f"Pointer({dtype.instance_class.__name__}, {digest})")


register_model(Pointer)(models.PointerModel)


def pointer_to(example: Any) -> Any:
    """Numba's type of a pointer to a named tuple like this one."""
    return Pointer(numba.typeof(example))


def _field(kind: Any, name: str) -> tuple[int, Any]:
    index = kind.dtype.fields.index(name)
    return index, kind.dtype.types[index]


@infer_getattr
class _Attributes(AttributeTemplate):
    key = Pointer

    def generic_resolve(self, kind: Any, name: str) -> Any:
        if name not in kind.dtype.fields:
            return None
        field = _field(kind, name)[1]
        return Pointer(field) if isinstance(field, BaseNamedTuple) else field


@lower_getattr_generic(Pointer)
def _load(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    index, field = _field(kind, name)
    place = cgutils.gep_inbounds(builder, pointer, 0, index)
    return place if isinstance(field, BaseNamedTuple) else context.unpack_value(builder, field, place)


def lend(value: _Tuple) -> _Tuple:
    """Return a pointer to a named tuple, valid until the function returns that calls this; in Python, itself."""
    return value


@infer_global(lend)
class _Template(AbstractTemplate):
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        (value,) = arguments
        return (value if isinstance(value, Pointer) else Pointer(value))(value)


@lower_builtin(lend, types.Any)
def _refer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    (kind,), (value,) = signature.args, arguments
    if isinstance(kind, Pointer):
        return value
    place = cgutils.alloca_once(builder, context.get_data_type(kind))
    context.pack_value(builder, kind, value, place)
    return place


class Alone:
    """A function that is compiled on its own.

    Attributes:
        compiled: all of them that this process has compiled, or loaded from the cache.
    """

    compiled: ClassVar[list["Alone"]] = []
    lock = threading.RLock()

    def __init__(self, function: Callable[..., Any], signature: Callable[[], Any]) -> None:
        self.function: Any = getattr(function, "py_func", function)
        self._signature = signature
        self._address = 0

    def address(self) -> int:
        """Its address; the first call compiles it, or loads it from the cache."""
        with self.lock:
            if not self._address:
                signature = self._signature()
                # Numba makes arrays of pointers only where it counts references.
                options = {**INSIDE, "_nrt": POINTER in signature.args}
                stored = is_own(self.function)
                self._kept = compiled(_renamed(self.function), signature, stored=stored, **options)
                (result,) = self._kept.overloads.values()
                self._address = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
                self.compiled.append(self)
        return self._address


def _renamed(function: Any) -> Any:
    """The same function under another name: Numba stores functions by name, and callers may contain this one too."""
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__module__, copy.__qualname__ = function.__module__, f"{function.__qualname__}.part"
    return copy


def _call(context: Any, builder: Any, address: Any, signature: Any, arguments: Any) -> Any:
    """Generate the call of a function with Numba's calling convention; what it raises, its caller raises."""
    convention = context.call_conv
    kind = convention.get_function_type(signature.return_type, signature.args)
    function = builder.inttoptr(address, kind.as_pointer())
    status, result = convention.call_function(builder, function, signature.return_type, signature.args, arguments)
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return result


def _make_callable(function: Any, make_arguments: Callable[[], Any], generate: Callable[..., Any]) -> None:
    """Make compiled code that calls the Python function `function` contain what `generate` generates.

    Args:
        function: what calls are recognised by.
        make_arguments: returns the signature with all arguments.
        generate: like an argument of Numba's `lower_builtin`.
    """

    class Template(AbstractTemplate):
        key = function

        def generic(self, given: Any, keywords: Any) -> Any:
            signature = make_arguments()
            if len(given) != len(signature.args) or keywords:
                return None
            pairs = zip(given, signature.args, strict=True)
            return signature.replace(args=[k if w == POINTER and k in (ROW, ROWS) else w for k, w in pairs])

    infer_global(function, types.Function(Template))
    lower_builtin(function, VarArg(types.Any))(generate)


class Interface:
    """What functions of one kind take and return. Compiled code calls each of them by its address.

    An array is seven arguments for Numba. Where that is too slow, the functions take a `POINTER` to its first element,
    and calls pass an array of `ROW` or `ROWS` for it all the same.

    Attributes:
        call: ``call(address, *arguments)``, for compiled code; in Python, it calls the Python function.
    """

    def __init__(self, signature: Any) -> None:
        """Args: signature: as Numba has it."""
        self._signature = signature
        self._chosen: dict[Any, Alone] = {}
        functions: dict[int, Callable[..., Any]] = {}
        self._functions = functions

        def call(address: int, *arguments: Any) -> Any:
            return functions[address](*arguments)

        self.call = call
        whole = signature.replace(args=(INTEGER, *signature.args))
        _make_callable(call, lambda: whole, self._generate)

    def _generate(self, context: Any, builder: Any, whole: Any, arguments: Any) -> Any:
        passed = [
            make_array(kind)(context, builder, value).data if kind != wanted else value
            for kind, wanted, value in zip(whole.args[1:], self._signature.args, arguments[1:], strict=True)
        ]
        return _call(context, builder, arguments[0], self._signature, passed)

    def address(self, function: Callable[..., Any]) -> int:
        """The address of a function, a Python function or Numba's; the first call compiles it.

        Raises:
            numba.core.errors.NumbaError: it cannot be compiled.
        """
        alone = self._chosen.setdefault(function, Alone(function, lambda: self._signature))
        address = alone.address()
        self._functions[address] = alone.function
        return address


class PartError(RuntimeError):
    """A part could not be compiled; its caller has ended early."""


_FAILED = "a function of pidtsm could not be compiled: the reason is on standard error"
_ATTEMPTS = 3
"""Ctrl-C cannot pass through compiled code, so a compilation that it has interrupted begins again."""
_PREPARE = "pidtsm_core.compiling.prepare"
_PREPARE_TYPE = ir.FunctionType(_WORD, [_WORD])


class _Part:
    """A function that is compiled when the first call reaches it.

    Compiled code finds its address in a word at a symbol whose name does not change, so that Numba can store the
    calling function.
    """

    parts: ClassVar[dict[int, "_Part"]] = {}
    """All of them, by the address of that word."""

    def __init__(self, function: Callable[..., Any], signature: Callable[[], Any]) -> None:
        self._alone, self._signature = Alone(function, signature), signature
        self._word = ctypes.c_int64(0)
        self._symbol = f"{function.__module__}.{function.__qualname__}.address"
        binding.add_symbol(self._symbol, ctypes.addressof(self._word))
        self.parts[ctypes.addressof(self._word)] = self
        _make_callable(function, signature, self._generate)

    def prepare(self) -> None:
        """Compile it, unless that has happened."""
        self._word.value = self._alone.address()

    def _generate(self, context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        word = builder.module.globals.get(self._symbol) or ir.GlobalVariable(builder.module, _WORD, self._symbol)
        with builder.if_then(builder.icmp_unsigned("==", builder.load(word), _WORD(0)), likely=False):
            prepare = cgutils.get_or_insert_function(builder.module, _PREPARE_TYPE, _PREPARE)
            failed = builder.call(prepare, [builder.ptrtoint(word, _WORD)])
            with builder.if_then(builder.icmp_unsigned("!=", failed, _WORD(0)), likely=False):
                context.call_conv.return_user_exc(builder, PartError, (_FAILED,))
        return _call(context, builder, builder.load(word), self._signature(), arguments)


@ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
def _prepare(word: int) -> int:
    """Called by compiled code that needs a part; return 1 if there is none, for which it raises a `PartError`."""
    for _ in range(_ATTEMPTS):
        try:
            _Part.parts[word].prepare()
        except KeyboardInterrupt:
            continue
        except Exception:  # It cannot pass through compiled code.
            traceback.print_exc()
            return 1
        return 0
    return 1


binding.add_symbol(_PREPARE, ctypes.cast(_prepare, ctypes.c_void_p).value)

_KINDS = {
    int: INTEGER,
    float: FLOAT,
    bool: types.boolean,
    type(None): types.none,
    Array: ROW,
    tuple[float, float]: tuple_of(FLOAT, 2),
}
"""Numba's types by annotation; an array has one dimension."""


class PartOf:
    """A decorator that makes a function a part; from Python, it runs as Python."""

    def __init__(self, *make_examples: Callable[[], Any]) -> None:
        """Args: make_examples: return an example of each named tuple among the arguments, which are pointers."""
        self._make_examples = make_examples
        self._parts: list[_Part] = []

    def __call__(self, function: _Function) -> _Function:
        self._parts.append(_Part(function, cache(lambda: self._signature(function))))
        return function

    @cached_property
    def _kinds(self) -> Mapping[Any, Any]:
        """Numba's types by annotation."""
        examples = [make() for make in self._make_examples]
        return {**_KINDS, **{type(each): pointer_to(each) for each in examples}}

    def _signature(self, function: Any) -> Any:
        hints = get_type_hints(function)
        result = self._kinds[hints.pop("return")]
        return result(*(self._kinds[hint] for hint in hints.values()))

    def prepare(self) -> None:
        """Compile every part, for a caller that must not wait later."""
        for part in self._parts:
            part.prepare()


@intrinsic
def call_c(_typing: Any, address: Any, addresses: Any) -> Any:
    """Call the C function at `address`, which takes these addresses, a tuple of integers, and returns nothing."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        passed = cgutils.unpack_tuple(builder, arguments[1])
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in passed])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), passed)
        return context.get_dummy_value()

    return types.void(address, addresses), generate
