"""Functions that are compiled alone and called by address, and named tuples that are passed by pointer."""

import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import TypingError

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, ROW, Interface, PartError, PartOf, lend
from pidtsm_core.compiling.decorators import njit


class Inner(NamedTuple):
    flag: bool
    numbers: Array


class Outer(NamedTuple):
    number: int
    inner: Inner
    table: Array


OUTER = Outer(3, Inner(True, np.array([1.0, 2.0])), np.array([[5.0, 6.0], [7.0, 8.0]]))
part = PartOf(lambda: OUTER)


def double(x: float, row: Array) -> float:
    return 2.0 * x + row[0]


def halve(x: float, row: Array) -> float:
    return 0.5 * x + row[0]


def misspelt(x: float, row: Array) -> float:
    return x + row.sise  # type: ignore[attr-defined]


INTERFACE = Interface(FLOAT(FLOAT, ROW))
choose = INTERFACE.call


@part
def change(outer: Outer, by: float) -> bool:
    """Change what the tuple's arrays contain."""
    outer.inner.numbers[0] += by
    outer.table[1, 0] = outer.inner.numbers[0]
    return outer.inner.flag


@njit
def call(address: int, x: float, row: Array) -> float:
    result: float = choose(address, x, row)
    return result


@njit
def change_it(outer: Outer, by: float) -> tuple[int, bool]:
    lent = lend(outer)
    return lend(lent).number, change(lent, by)


@pytest.mark.parametrize(("function", "expected"), [(double, 7.0), (halve, 2.5)])
def test_compiled_code_and_python_call_the_same_function(function: Any, expected: float) -> None:
    row, address = np.array([1.0]), INTERFACE.address(function)
    assert call(address, 3.0, row) == choose(address, 3.0, row) == expected
    assert INTERFACE.address(function) == address


def test_a_function_that_does_not_compile_is_an_error_in_python_and_hinders_no_other() -> None:
    with pytest.raises(TypingError, match="sise"):
        INTERFACE.address(misspelt)
    assert call(INTERFACE.address(double), 1.0, np.zeros(1)) == 2.0


@part
def misspelt_part(outer: Outer, by: float) -> bool:
    return outer.inner.flags > by  # type: ignore[attr-defined]


@part
def caller_of_it(outer: Outer, by: float) -> bool:
    return misspelt_part(outer, by)


@njit
def change_and_fail(outer: Outer, by: float) -> bool:
    lent = lend(outer)
    change(lent, by)
    return caller_of_it(lent, by)


def test_a_part_that_does_not_compile_when_it_is_needed_is_an_error_in_python(
    capfd: pytest.CaptureFixture[str],
) -> None:
    before = OUTER.inner.numbers[0]
    with pytest.raises(PartError, match="compiled"):
        change_and_fail(OUTER, 1.0)
    assert OUTER.inner.numbers[0] == before + 1.0, "what came first has happened"
    assert "flags" in capfd.readouterr().err
    assert change_it(OUTER, -1.0) == (3, True), "others still work"


def test_a_named_tuple_is_read_and_its_arrays_are_changed_through_a_pointer() -> None:
    numbers, table = OUTER.inner.numbers, OUTER.table
    before = numbers[0]
    assert change_it(OUTER, 2.0) == (3, True)
    assert numbers[0] == table[1, 0] == before + 2.0
    assert lend(OUTER) is OUTER


ALONE = """
import sys
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.compiling.addresses import Alone
rollout("case1", duration=0.1)
print(*(each.function.__module__ for each in Alone.compiled))
"""


READY = """
from pidtsm_core import make_controller
from pidtsm_core.compiling.addresses import Alone
make_controller()
print(*(each.function.__name__ for each in Alone.compiled))
"""


def test_a_controller_for_a_loop_of_ones_own_has_nothing_left_to_compile_when_it_has_to_stop() -> None:
    ready = subprocess.run([sys.executable, "-c", READY], capture_output=True, text=True, check=True).stdout.split()
    assert {"step", "make_safe", "make_safe_blindly", "leave", "come_to_rest", "begin_approach_here", "limit_rate"} <= {
        *ready
    }


def test_a_rollout_compiles_only_the_members_that_it_has() -> None:
    ready: Any = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True).stdout
    modules = [module.removeprefix("pidtsm_core.") for module in ready.split()]
    assert modules.count("laws.sliding_mode") == 2, "command and advance of one of its many laws"
    assert "references.article" in modules
    assert not {"laws.pid", "references.chirp", "estimators.exact", "control.safe", "simulation.friction"} & {*modules}
