"""The signal table and the message that carries it have the same columns."""

import re
from pathlib import Path

import pytest

from pidtsm_core.signals import Signal

MESSAGE = Path(__file__).parents[2] / "pidtsm_msgs" / "msg" / "ControllerState.msg"


def test_rows_are_numbered_without_gaps() -> None:
    assert [int(signal) for signal in Signal] == list(range(len(Signal)))


@pytest.mark.skipif(not MESSAGE.is_file(), reason="the message definitions are not beside this package")
def test_every_signal_is_a_field_of_the_message_in_the_same_order() -> None:
    fields = re.findall(r"^float64\[\]\s+(\w+)", MESSAGE.read_text(), flags=re.MULTILINE)
    assert fields == [signal.name.lower() for signal in Signal]
