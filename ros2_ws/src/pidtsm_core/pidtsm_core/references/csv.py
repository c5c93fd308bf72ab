"""A motion from a file."""

import csv
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value, names
from pidtsm_core.references.base import Reference
from pidtsm_core.references.piecewise import evaluate, through

_KINDS = ("q", "dq", "ddq")
_SEPARATORS = (",", ";", "\t")
_LONGEST_LINE = 1 << 20
_SHOWN = 200
"""Largest number of characters of a line in a message."""


@dataclass(frozen=True)
class _FromFile(Reference):
    def pack(self, values: Mapping[str, Value], group: str, joints: int) -> Array:
        """The motion of the file, shape (joints, 7 (rows - 1) + 1); see `piecewise`.

        Raises:
            ParameterError: the file cannot be read or used; the message names file and line.
        """
        parameter = f"{group}.file"
        file = str(values[parameter])
        try:
            times, samples = _read(file, names(values["joints"]))
        except (OSError, ValueError, csv.Error) as error:
            raise ParameterError(f"{parameter}: {error}", parameter) from None
        return self._joined(times, samples, f"{parameter}: {file}", parameter)

    @staticmethod
    def _joined(times: Array, samples: Array, where: str, parameter: str) -> Array:
        """The motion through the samples; see `pack`."""
        with suppress(ValueError), np.errstate(all="ignore"):
            packed = through(times, samples)
            if np.isfinite(packed).all():
                return packed
        raise ParameterError(f"{where}: its numbers are too large, or its times too close", parameter)


def _read(file: str, joints: tuple[str, ...]) -> tuple[Array, Array]:
    """Times, shape (rows,), and q, with q' and q'' if the file has them, shape (rows, 1 to 3, joints).

    Raises:
        OSError: the file cannot be read.
        ValueError: the content of the file cannot be used.
    """
    if not file:
        raise ValueError("name a file with the columns time, " + ", ".join(f"q_{joint}" for joint in joints))
    rows: list[list[float]] = []
    header: list[str] = []
    kinds: tuple[str, ...] = ()
    for number, words, separator in _lines(file):
        where = f"{file}, line {number}"
        if not header:
            header, kinds = words, _kinds(words, joints, where)
        else:
            row = _row(words, separator, len(header), where)
            if rows and row[header.index("time")] <= rows[-1][header.index("time")]:
                raise ValueError(f"{where}: time must increase from line to line")
            rows.append(row)
    if not header:
        _kinds([], joints, f"{file}, line 1")
    if len(rows) < 2:
        raise ValueError(f"{file}: a motion needs at least two lines of numbers")
    table = np.array(rows)
    samples = np.stack([table[:, [header.index(f"{kind}_{j}") for j in joints]] for kind in kinds], axis=1)
    return table[:, header.index("time")], samples


def _lines(file: str) -> Iterator[tuple[int, list[str], str]]:
    """Number, words and separator of each line that is not empty, as spreadsheets write them.

    They may write a mark at the start of the file, a line ``sep=;``, quotes, and in countries with a decimal comma a
    semicolon between the words.
    """
    if not Path(file).is_file() and Path(file).exists():
        raise ValueError(f"{file} is not a file")
    with Path(file).open(encoding="utf-8-sig", newline="") as text:
        try:
            first = text.readline(_LONGEST_LINE)
            separator = max(_SEPARATORS, key=first.count)
            before = int(first.strip().lower() in [f"sep={each}" for each in _SEPARATORS])
            if not before:
                text.seek(0)
            lines = csv.reader(text, delimiter=separator, skipinitialspace=separator != "\t")
            for words in lines:
                if any(map(str.strip, words)):
                    yield before + lines.line_num, [word.strip() for word in words], separator
        except UnicodeDecodeError:
            raise ValueError(f"{file} is not UTF-8 text; save it as CSV UTF-8") from None


def _row(words: list[str], separator: str, columns: int, where: str) -> list[float]:
    """The numbers of a line; where a semicolon separates them, they may have a decimal comma.

    Raises:
        ValueError: there are not as many as columns, or they are not finite numbers.
    """
    if len(words) != columns:
        raise ValueError(f"{where}: {len(words)} values for {columns} columns")
    try:
        row = [float(word.replace(",", ".") if separator == ";" else word) for word in words]
    except ValueError:
        raise ValueError(f"{where}: not all of {_shown(words)} are numbers") from None
    if not all(map(math.isfinite, row)):
        raise ValueError(f"{where}: not all of {_shown(words)} are finite")
    return row


def _shown(words: list[str]) -> str:
    """Words for a message, in one line that is not too long: a quote that does not end reaches to the end of a file."""
    text = " ".join(", ".join(words).split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."


def _kinds(header: list[str], joints: tuple[str, ...], where: str) -> tuple[str, ...]:
    """Quantities in the columns: q, or q and dq, or all three.

    Raises:
        ValueError: a column is missing, unknown or duplicated.
    """
    for count in (1, 2, 3):
        kinds = _KINDS[:count]
        if sorted(header) == sorted(["time", *(f"{kind}_{joint}" for kind in kinds for joint in joints)]):
            return kinds
    wanted = ", ".join(f"q_{joint}" for joint in joints)
    raise ValueError(
        f"{where}: the columns are {_shown(header) or 'none'}; wanted are time, {wanted}, "
        "in any order, and for all joints dq_, or dq_ and ddq_, where they are known"
    )


CSV = _FromFile(
    name="csv",
    summary="spline through a file: columns time, q_JOINT, optional dq_JOINT, ddq_JOINT (s, rad); then at rest",
    parameters=(Parameter("file", "", "file, relative to the folder where the node was started", read_only=True),),
    joints=0,
    evaluate=evaluate,
)
