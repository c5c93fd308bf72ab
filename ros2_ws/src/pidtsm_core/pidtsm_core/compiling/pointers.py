"""Named tuples that compiled code passes by pointer.

Numba passes a named tuple by value: as hundreds of values for one that contains dozens of arrays, which LLVM takes
seconds to compile and every call takes time to copy. A pointer is one number, with the same attributes.
"""

import hashlib
from typing import Any, TypeVar

from numba.core import cgutils, types
from numba.core.types.containers import BaseNamedTuple
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global
from numba.extending import infer_getattr, lower_builtin, lower_getattr_generic, models, register_model

_Tuple = TypeVar("_Tuple")


class Pointer(types.Type):
    """The type of a pointer to the named tuple of type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        digest = hashlib.sha256(str(dtype).encode()).hexdigest()[:12]
        super().__init__(f"Pointer({dtype.instance_class.__name__}, {digest})")


register_model(Pointer)(models.PointerModel)


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
