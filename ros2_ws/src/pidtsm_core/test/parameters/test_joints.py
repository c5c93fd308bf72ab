"""Joints are matched by name, in any order; unusable messages are refused with the cause."""

import math
from array import array
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pidtsm_core.parameters.joints import JointOrder, MessageError

NAMES = ["shoulder", "elbow", "wrist"]
VALUES = {"shoulder": 1.0, "elbow": 2.0, "wrist": 3.0}


@pytest.mark.parametrize("names", permutations(NAMES))
def test_values_go_to_their_joints(names: tuple[str, ...]) -> None:
    order, target = JointOrder(NAMES), np.zeros(3)
    for message_names in (list(names), NAMES, list(names)):
        order.read(message_names, array("d", [VALUES[n] for n in message_names]), "position", target)
        assert target.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("names", "values", "cause"),
    [
        ([], [], "joints shoulder, elbow, wrist are missing"),
        (NAMES[:2], [1.0, 2.0], "joints wrist are missing"),
        ([*NAMES, "hand"], [1.0, 2.0, 3.0, 4.0], "unknown joints hand"),
        (["shoulder", "elbow", "hand"], [1.0, 2.0, 3.0], "unknown joints hand, missing wrist"),
        (["shoulder", "elbow", "elbow"], [1.0, 2.0, 3.0], "named twice"),
        (NAMES, [1.0, 2.0], "position has 2 values for 3 joints"),
        (NAMES, [], "position has 0 values for 3 joints"),
        (NAMES, [1.0, math.nan, 2.0], "position is not finite"),
        (NAMES, [math.inf, -math.inf, 0.0], "position is not finite"),
        (NAMES, [1e300, -1e300, 0.0], "position is absurd"),
    ],
)
def test_unusable_messages_are_refused_and_change_nothing(names: list[str], values: list[float], cause: str) -> None:
    order, target = JointOrder(NAMES), np.full(3, 7.0)
    for _ in range(2):
        with pytest.raises(MessageError, match=cause):
            order.read(names, array("d", values), "position", target)
    assert target.tolist() == [7.0, 7.0, 7.0]


@given(st.lists(st.sampled_from([*NAMES, "hand"]), max_size=5), st.lists(st.floats(), max_size=5))
def test_only_complete_finite_messages_pass(names: list[str], values: list[float]) -> None:
    target = np.zeros(3)
    usable = sorted(names) == sorted(NAMES) and len(values) == 3 and all(abs(v) < 1e6 for v in values)
    try:
        JointOrder(NAMES).read(names, array("d", values), "effort", target)
    except MessageError:
        assert not usable
    else:
        assert usable
        assert target.tolist() == [values[names.index(n)] for n in NAMES]
