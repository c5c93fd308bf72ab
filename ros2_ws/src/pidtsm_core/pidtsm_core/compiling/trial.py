"""Whether functions from outside compile, and what they return makes sense."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.errors import MemberError

_PLACE = re.compile(r'File "([^"]+)", line (\d+)')
_SIGNATURE = re.compile(r"to signature '(\(.*?\))' due to \"TypeError: (.*?)\"")
_RETURNED = re.compile(r"No conversion from (.+) to (?:float64|UniTuple\(float64 x (\d)\)) for")
_ALLOCATES = "Only accept returning of array"
_REJECTED = "Rejected as the implementation raised a specific error:"
_CALLER = "During: resolving callee"
_NO_REASON = re.compile(r"(\w+Error: )?Failed in|During:|File |raised from")


@contextmanager
def compiles(what: str) -> Iterator[None]:
    """Whatever is compiled within the block is a part of `what`.

    Raises:
        MemberError: it cannot be compiled; the message is one line.
    """
    try:
        yield
    except Exception as reason:  # Numba raises more than its own.
        raise MemberError(f"{what} does not compile: {_reason(str(reason) or type(reason).__name__)}") from None


def _reason(text: str) -> str:
    """What Numba's message says about the innermost function that it rejects, and where."""
    innermost = text.rpartition(_REJECTED)[2].partition(_CALLER)[0]
    if found := _SIGNATURE.search(innermost):
        return f"{found[2]}, its arguments are {found[1]}"
    if found := _RETURNED.search(innermost):
        return f"it returns {found[1]}, not {found[2] or 'one'} float{'s' if found[2] else ''}"
    if _ALLOCATES in innermost:
        return "it creates an array, which a compiled law must not; compute with numbers"
    lines = [line.strip() for line in innermost.splitlines()]
    reason = next((line for line in lines if line and not _NO_REASON.match(line)), "unknown reason")
    place = _PLACE.search(innermost)
    return reason + (f" ({Path(place[1]).name}, line {place[2]})" if place else "")


def check_finite(what: str, values: Any, given: str) -> None:
    """Check numbers that `what` has returned for what was given.

    Raises:
        MemberError: one of them is not finite.
    """
    if not np.isfinite(values).all():
        raise MemberError(f"{what} returns {np.asarray(values).tolist()} for {given}; every value must be finite")
