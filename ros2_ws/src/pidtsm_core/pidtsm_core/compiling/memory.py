"""Memory that Python fills with a named tuple, and in which compiled code finds it by address.

A call of compiled code converts each array among its arguments, which takes about a microsecond in a node, whose
processor caches are cold. An address is one number, however much there is at it.
"""

import ctypes
from collections.abc import Callable
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from numba import typeof, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from pidtsm_core.compiling.addresses import Pointer

_Tuple = TypeVar("_Tuple", bound=tuple[Any, ...])


class Layout(Generic[_Tuple]):
    """How named tuples of one type lie in memory: numbers, arrays, and further tuples of these.

    Attributes:
        at: in compiled code, ``at(address)`` is a pointer to the tuple that is there.
        copy: in compiled code, ``copy(address)`` is a pointer to a copy of it, valid until the function returns that
            calls this. Nothing else can change the copy, so a loop over it is a quarter faster.
    """

    def __init__(self, make_example: Callable[[], _Tuple]) -> None:
        """Args: make_example: returns a tuple of the type; called when the layout is first needed."""
        self._make_example = make_example

        @intrinsic
        def at(_typing: Any, address: Any) -> Any:
            def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
                return builder.inttoptr(arguments[0], context.get_data_type(self.kind).as_pointer())

            return Pointer(self.kind)(address), generate

        @intrinsic
        def copy(_typing: Any, address: Any) -> Any:
            def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
                form = context.get_data_type(self.kind)
                place, source = cgutils.alloca_once(builder, form), builder.inttoptr(arguments[0], form.as_pointer())
                size = context.get_constant(types.intp, context.get_abi_sizeof(form))
                cgutils.raw_memcpy(builder, place, source, size, 1)
                return place

            return Pointer(self.kind)(address), generate

        self.at: Callable[[int], _Tuple] = at
        self.copy: Callable[[int], _Tuple] = copy

    @cached_property
    def kind(self) -> Any:
        """Numba's type of the tuples."""
        return typeof(self.example)

    @cached_property
    def example(self) -> _Tuple:
        """A tuple of the type."""
        return self._make_example()

    @cached_property
    def form(self) -> Any:
        """The type as a structure of C, which has the sizes and gaps that compiled code expects."""
        return _form(self.example)

    def store(self, value: _Tuple) -> "Stored[_Tuple]":
        """Put a tuple into memory of its own, which is filled when its address is first needed."""
        return Stored(self, value)


class Stored(Generic[_Tuple]):
    """A named tuple in memory. Its arrays stay where they are: Python and compiled code share them.

    Attributes:
        value: the tuple; kept, so that its arrays live as long as the memory.
    """

    def __init__(self, layout: Layout[_Tuple], value: _Tuple) -> None:
        self.value = value
        self._layout = layout
        self._memory: Any = None

    @property
    def address(self) -> int:
        """Where compiled code finds the tuple, see `Layout.at`; it never changes.

        Raises:
            TypeError: see `write`.
        """
        if self._memory is None:
            self._memory = self._layout.form()
            self.write(self.value)
        return ctypes.addressof(self._memory)

    def write(self, value: _Tuple) -> None:
        """Replace the tuple.

        Raises:
            TypeError: its type is not that of the layout; compiled code would misread it.
        """
        if self._memory is not None:
            _check(value, self._layout.example, type(value).__name__)
            _fill(self._memory, value)
        self.value = value


_NUMBERS = {bool: ctypes.c_bool, int: ctypes.c_int64, float: ctypes.c_double}
_NUMBER_OF = {**{kind: kind for kind in _NUMBERS}, np.bool_: bool, np.int64: int, np.float64: float}
"""Python's type of a number, by its type."""


def _form(value: Any) -> Any:
    """The structure of C that has the layout of a value in compiled code."""
    if isinstance(value, tuple):
        fields = [(f"field{i}", _form(each)) for i, each in enumerate(value)]
    elif isinstance(value, np.ndarray):
        sizes = ctypes.c_int64 * value.ndim
        address, size = ctypes.c_void_p, ctypes.c_int64
        kinds = {"owner": address, "parent": address, "items": size, "item_size": size, "data": address}
        fields = [*kinds.items(), ("shape", sizes), ("strides", sizes)]
    else:
        return _NUMBERS[type(value)]
    return type(type(value).__name__, (ctypes.Structure,), {"_fields_": fields})


def _check(value: Any, example: Any, name: str) -> None:
    """Check that compiled code may read the value as it reads the example; `typeof` takes a millisecond for this.

    Raises:
        TypeError: it has not.
    """
    if isinstance(example, tuple):
        if type(value) is not type(example) or len(value) != len(example):
            raise TypeError(f"{name} is a {type(value).__name__}, not a {type(example).__name__}")
        for i, (mine, known) in enumerate(zip(value, example, strict=True)):
            _check(mine, known, f"{name}.{getattr(example, '_fields', range(len(example)))[i]}")
    elif isinstance(example, np.ndarray):
        ordered = example.flags.c_contiguous
        if (
            not isinstance(value, np.ndarray)
            or _type_of(value) != _type_of(example)
            or ordered > value.flags.c_contiguous
        ):
            order = ", in C order" if ordered else ""
            raise TypeError(f"{name} is not an array of {example.ndim} dimensions and type {example.dtype}{order}")
    elif _NUMBER_OF.get(type(value)) is not type(example):
        raise TypeError(f"{name} is a {type(value).__name__}, not a {type(example).__name__}")


def _type_of(array: NDArray[Any]) -> tuple[Any, ...]:
    return array.dtype, array.ndim, array.flags.writeable, array.flags.aligned


def _fill(memory: Any, value: Any) -> None:
    """Write a value to a structure."""
    if isinstance(value, np.ndarray):
        memory.items, memory.item_size, memory.data = value.size, value.itemsize, value.__array_interface__["data"][0]
        memory.shape[:], memory.strides[:] = value.shape, value.strides
        return
    for i, each in enumerate(value):
        if isinstance(each, tuple | np.ndarray):
            _fill(getattr(memory, f"field{i}"), each)
        else:
            setattr(memory, f"field{i}", each.item() if isinstance(each, np.generic) else each)
