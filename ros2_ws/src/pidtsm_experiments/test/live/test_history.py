"""Curves of the last seconds keep every peak within bounded memory; metrics are those of all samples."""

import numpy as np
import pytest

from pidtsm_core.recording.metrics import metrics
from pidtsm_experiments.live.history import SPAN, History, Measurement

MS = 1_000_000
RATE = 1000


def test_no_peak_is_missing_and_the_span_is_bounded() -> None:
    history = History()
    stamps = np.arange(30 * RATE) * MS + 12345
    values = np.zeros((stamps.size, 1, 2))
    values[25_003, 0] = 7.0, -7.0
    for part in np.array_split(np.arange(stamps.size), 700):
        history.add(stamps[part], values[part])
    curves = history.curves()
    assert curves.time[-1] - curves.time[0] == pytest.approx(SPAN, abs=0.1)
    assert (curves.values.max(axis=(0, 1)), curves.values.min(axis=(0, 1))) == (
        pytest.approx([7.0, 0.0]),
        pytest.approx([0.0, -7.0]),
    )
    assert curves.time[np.argmax(curves.values[:, 0, 0])] == pytest.approx(25.0, abs=0.1)


def test_a_clock_that_is_set_begins_new_curves() -> None:
    history = History()
    history.add(np.arange(1000) * MS + 10**15, np.ones((1000, 1, 1)))
    history.add(np.arange(1000) * MS, np.full((1000, 1, 1), 2.0))
    assert (history.curves().values == 2.0).all()


def test_the_metrics_since_the_mark_are_those_of_a_run() -> None:
    dice = np.random.default_rng(0)
    stamps, error, effort = np.arange(500) * MS, *dice.normal(size=(2, 500, 3))
    measured = Measurement()
    for part in np.array_split(np.arange(500), 7):
        measured.add(stamps[part], error[part], effort[part])
    expected = metrics(stamps * 1e-9, error, effort, np.zeros_like(effort))
    np.testing.assert_allclose(measured.rmse, np.array(expected["rmse"], dtype=float))
    np.testing.assert_allclose(measured.eci, np.array(expected["eci"], dtype=float))
    assert measured.samples == 500


def test_the_error_since_the_mark_is_the_first_of_it() -> None:
    measured = Measurement()
    for second in range(30):
        stamps = (np.arange(RATE) + second * RATE) * MS
        measured.add(stamps, np.full((RATE, 1), float(second)), np.zeros((RATE, 1)))
    curves = measured.error()
    assert curves.values.max() == SPAN - 1.0
    assert curves.time[-1] < SPAN
