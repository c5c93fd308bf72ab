"""Two recordings are compared to the last bit; NumPy judges, and so does one bit that a test changes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_experiments.runs.replay import agreement, contradictions, experiment_of_result


@pytest.fixture(scope="module")
def run() -> Recording:
    return rollout("noise", duration=0.05)


def changed(run: Recording, name: str, place: Any, value: Any = None) -> Recording:
    """A copy in which one number is the next one, or another."""
    values = getattr(run, name).copy()
    values[place] = np.nextafter(values[place], np.inf) if value is None else value
    return replace(run, **{name: values})


def test_a_recording_agrees_with_itself_in_everything(run: Recording) -> None:
    found = agreement(run, run)
    assert found.agrees
    assert (found.samples, found.lacking, found.surplus, found.differences) == (50, 0, 0, ())
    assert len(found.compared) == 6 + len(Signal) + run.status.shape[1]


@pytest.mark.parametrize(
    ("name", "place", "quantity", "joint"),
    [
        ("position", (30, 1), "position", "joint2"),
        ("effort", (0, 0), "effort", "joint1"),
        ("reference", (7, 2, 1), "reference_acceleration", "joint2"),
        ("signals", (49, Signal.ADAPTIVE_GAIN, 0), "adaptive_gain", "joint1"),
    ],
)
def test_one_bit_is_found(run: Recording, name: str, place: Any, quantity: str, joint: str) -> None:
    other = changed(run, name, place)
    found = agreement(other, run)
    (only,) = found.differences
    assert not found.agrees
    assert (only.quantity, only.joint, only.sample, only.time) == (quantity, joint, place[0], run.time[place[0]])
    recorded, again = getattr(other, name)[place], getattr(run, name)[place]
    assert (only.recorded, only.again, only.largest) == (recorded, again, abs(recorded - again))


def test_the_sign_of_a_zero_and_the_status_count(run: Recording) -> None:
    zero = changed(run, "effort", (3, 0), 0.0)
    (only,) = agreement(changed(run, "effort", (3, 0), -0.0), zero).differences
    assert (only.sample, only.largest) == (3, 0.0)
    (only,) = agreement(changed(run, "status", (9, 0), 2), run).differences
    assert (only.quantity, only.joint, only.recorded) == ("mode", "", 2.0)


def test_the_first_sample_comes_first(run: Recording) -> None:
    later = changed(changed(run, "position", (40, 0)), "effort", (20, 1))
    assert [each.quantity for each in agreement(later, run).differences] == ["effort", "position"]


def test_a_recording_that_was_cut_off_agrees_as_far_as_it_goes(run: Recording) -> None:
    names = ("time", "stamps_ns", "position", "velocity", "effort", "reference", "signals", "status")
    part = replace(run, **{name: getattr(run, name)[:20] for name in names})
    found = agreement(part, run)
    assert found.agrees
    assert (found.samples, found.lacking) == (20, 30)
    found = agreement(run, part)
    assert not found.agrees
    assert found.surplus == 30


def test_without_the_controller_only_the_truth_is_compared(run: Recording) -> None:
    found = agreement(replace(run, lacking=("controller/state",), signals=np.zeros_like(run.signals)), run)
    assert found.agrees
    assert "commanded_effort" not in found.compared


def test_the_parameters_alone_give_the_same_bits(run: Recording) -> None:
    lists = {
        node: {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
        for node, values in run.parameters.items()
    }
    assert contradictions(lists, run.parameters) == []
    again = rollout(experiment_of_result(run, lists))
    for name in ("position", "velocity", "effort", "reference", "signals", "status"):
        assert getattr(again, name).tobytes() == getattr(run, name).tobytes(), name
    lists["controller"]["law.k1"] = 99.0
    assert contradictions(lists, run.parameters) == ["controller.law.k1"]
