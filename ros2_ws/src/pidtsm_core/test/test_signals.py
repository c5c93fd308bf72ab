"""Signals and status of the controller and its message have the same fields in the same order."""

import re
from enum import IntEnum
from pathlib import Path

import pytest

from pidtsm_core.signals import Fault, Mode, Signal, Status, Stop, Violation

MESSAGE = Path(__file__).parents[2] / "pidtsm_msgs" / "msg" / "ControllerState.msg"
BESIDE = pytest.mark.skipif(not MESSAGE.is_file(), reason="the message definitions are not beside this package")


@pytest.mark.parametrize("places", [Signal, Status])
def test_rows_are_numbered_without_gaps(places: type[IntEnum]) -> None:
    assert [int(place) for place in places] == list(range(len(places)))


@BESIDE
@pytest.mark.parametrize(("places", "kind"), [(Signal, r"float64\[\]"), (Status, "uint8")])
def test_everything_is_a_field_of_the_message_in_the_same_order(places: type[IntEnum], kind: str) -> None:
    fields = re.findall(rf"^{kind}\s+([a-z_]+)", MESSAGE.read_text(), flags=re.MULTILINE)
    assert fields == [place.name.lower() for place in places]


@BESIDE
def test_modes_faults_and_violations_have_the_numbers_of_the_message() -> None:
    constants = re.findall(r"^uint8\s+([A-Z_]+)=(\d+)", MESSAGE.read_text(), flags=re.MULTILINE)
    known = [(member.name, int(member)) for family in (Mode, Fault, Violation, Stop) for member in family]
    assert [(name, int(value)) for name, value in constants] == known
