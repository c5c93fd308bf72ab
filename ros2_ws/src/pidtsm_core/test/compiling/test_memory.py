"""Memory that Python fills, and in which compiled code finds a named tuple by address."""

import ctypes
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.memory import Layout


class Inner(NamedTuple):
    flag: bool
    number: int
    last: bool


class Outer(NamedTuple):
    begins: bool
    inner: Inner
    size: float
    table: Array
    flags: NDArray[np.bool_]
    apart: Array  # its elements need not be neighbours
    ends: bool


def outer(number: int = 3, size: float = 0.5) -> Outer:
    table = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    apart = np.arange(6.0)[::2]
    return Outer(True, Inner(False, number, True), size, table, np.array([False, True]), apart, False)


LAYOUT = Layout(outer)
outer_at, outer_copy = LAYOUT.at, LAYOUT.copy


@njit
def read(address: int, numbers: Array) -> int:
    found = outer_at(address)
    inner = found.inner
    flags = found.begins, inner.flag, inner.last, found.flags[0], found.flags[1], found.ends
    number = 0
    for flag in flags:
        number = 2 * number + flag
    numbers[0], numbers[1], numbers[2], numbers[3] = inner.number, found.size, found.table[1, 2], found.apart[2]
    found.table[0, 1] = -1.0
    return number


def test_compiled_code_finds_what_python_has_stored_and_both_share_the_arrays() -> None:
    stored, numbers = LAYOUT.store(outer()), np.zeros(4)
    assert read(stored.address, numbers) == 0b101010
    assert numbers.tolist() == [3.0, 0.5, 6.0, 4.0]
    assert stored.value.table[0, 1] == -1.0


def test_what_is_written_again_is_found_at_the_same_address() -> None:
    stored, numbers = LAYOUT.store(outer()), np.zeros(4)
    address = stored.address
    stored.write(outer(number=-7, size=np.float64(1e300))._replace(apart=np.array([7.0, 8.0, 9.0])))
    assert stored.address == address
    read(address, numbers)
    assert numbers.tolist() == [-7.0, 1e300, 6.0, 9.0]


@njit
def read_copy(address: int, numbers: Array) -> None:
    found = outer_copy(address)
    found.table[0, 1] = -2.0
    numbers[0], numbers[1], numbers[2] = found.inner.number, found.size, found.apart[2]


def test_a_copy_has_the_numbers_and_shares_the_arrays() -> None:
    stored, numbers = LAYOUT.store(outer()), np.zeros(3)
    read_copy(stored.address, numbers)
    assert numbers.tolist() == [3.0, 0.5, 4.0]
    assert stored.value.table[0, 1] == -2.0


@intrinsic
def abi_size(_typing: Any, value: Any) -> Any:
    """Numba's size of the tuple, bytes."""

    def generate(context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:
        return context.get_constant(types.int64, context.get_abi_sizeof(context.get_data_type(LAYOUT.kind)))

    return types.int64(value), generate


@njit
def size_in_compiled_code(value: int) -> int:
    return int(abi_size(value))


def test_the_structure_of_c_has_the_size_that_numba_gives_the_tuple() -> None:
    assert ctypes.sizeof(LAYOUT.form) == size_in_compiled_code(0)


@pytest.mark.parametrize(
    "change",
    [
        {"size": 1},
        {"begins": 0.0},
        {"table": np.zeros(2)},
        {"table": np.zeros((4, 6))[::2, ::2]},
        {"flags": np.zeros(2)},
    ],
    ids=lambda change: f"{next(iter(change))}",
)
def test_what_compiled_code_would_misread_is_refused(change: dict[str, Any]) -> None:
    wrong = outer()._replace(**change)
    with pytest.raises(TypeError, match="Outer"):
        _ = LAYOUT.store(wrong).address
    stored = LAYOUT.store(outer())
    address = stored.address
    with pytest.raises(TypeError, match="Outer"):
        stored.write(wrong)
    assert read(address, np.zeros(4)) == 0b101010
