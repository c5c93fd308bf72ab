"""Every change can be undone, and one definition decides which are large."""

from typing import Any

import pytest

from pidtsm_experiments.live.changes import LARGE, Changes, is_large, same


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (1.0, 1.0),
        (1.0, LARGE),
        (LARGE, 1.0),
        (-1.0, -LARGE),
        (0.0, 0.0),
        (2, 2.0),
        (1.0, (2.0, 3.0)),
        ((1.0, 10.0), (3.0, 10.0)),
        ((1.0, 2.0), [1.0, 2.0]),
        ((), ()),
        ("hold", "hold"),
        (True, True),
    ],
)
def test_a_change_within_the_factor_is_small(before: Any, after: Any) -> None:
    assert not is_large(before, after)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (1.0, 1.001 * LARGE),
        (1.001 * LARGE, 1.0),
        (1.0, 0.0),
        (0.0, 1e-9),
        (1.0, -1.0),
        (2.0, (2.0, 7.0)),
        ((1.0, 10.0), (1.0, 3.0)),
        ((1.0, 1.0), (1.0, 1.0, 1.0)),
        ((1.0, 1.0), ()),
        (1.0, float("nan")),
        (1.0, float("inf")),
        ("hold", "gravity"),
        (False, True),
        (None, 1.0),
    ],
)
def test_a_change_by_more_or_without_a_factor_is_large(before: Any, after: Any) -> None:
    assert is_large(before, after)
    assert is_large(after, before)


def test_steps_are_undone_one_by_one_and_all_together() -> None:
    changes = Changes(lambda: "12:00:00")
    changes.record("controller", {"law.k1": 3.0, "law.k2": 5.0}, {"law.k1": 4.0, "law.k2": 6.0})
    changes.record("simulator", {"payload.mass": 0.0}, {"payload.mass": 1.0})
    changes.record("controller", {"law.k1": 4.0}, {"law.k1": 5.0}, "by another program")
    assert str(changes.steps[-1]) == "controller law.k1: 4 → 5 (by another program)"
    assert changes.back(1) == {"controller": {"law.k1": 4.0}}
    assert changes.back(3) == {"controller": {"law.k1": 3.0, "law.k2": 5.0}, "simulator": {"payload.mass": 0.0}}
    changes.remove(changes.steps[-1:])
    assert changes.back(1) == {"simulator": {"payload.mass": 0.0}}
    changes.remove(list(changes.steps))
    assert changes.back(0) == {}


def test_what_does_not_differ_is_no_step() -> None:
    changes = Changes()
    changes.record("controller", {"law.k1": (3.0, 2.0)}, {"law.k1": [3.0, 2.0]})
    assert not changes.steps
    assert not same(1, True)


def test_another_law_is_one_step_and_brings_the_old_gains_back() -> None:
    changes = Changes()
    before = {"law.name": "article", "law.k1": 3.5, "stop.effort": "hold"}
    changes.record("controller", before, {"law.name": "computed_torque", "law.kp": 9.0, "stop.effort": "hold"})
    assert changes.back(1) == {"controller": {"law.name": "article", "law.k1": 3.5}}
    assert str(changes.steps[0]).startswith("controller law.name: article → computed_torque; law.k1: 3.5 → none; ")
    changes.record("controller", {f"law.k{i}": 1.0 for i in range(9)}, {f"law.k{i}": 2.0 for i in range(9)})
    assert str(changes.steps[1]).endswith("law.k2: 1 → 2; and 6 more")
