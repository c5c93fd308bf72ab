"""A run by name: its arrays, text, figure and tables."""

import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import make_controller, rollout
from pidtsm_core.signals import Signal

matplotlib.use("Agg")

OTHER_NAMES = {
    "POSITION": "estimated_position",
    "VELOCITY": "estimated_velocity",
    "ACCELERATION": "estimated_acceleration",
    "POSITION_ERROR": "estimated_error",
    "VELOCITY_ERROR": "estimated_velocity_error",
    "EFFORT": "commanded_effort",
}


@pytest.mark.parametrize("signal", Signal)
def test_every_signal_of_the_controller_has_a_name(run: Recording, signal: Signal) -> None:
    name = OTHER_NAMES.get(signal.name, signal.name.lower())
    np.testing.assert_array_equal(getattr(run, name), run.signals[:, signal])
    np.testing.assert_array_equal(run.arrays()[name], run.signals[:, signal])


def test_arrays_have_one_column_per_joint(run: Recording) -> None:
    assert {array.shape for array in run.arrays().values()} == {(2000, 2)}


def test_its_text_shows_what_it_is(run: Recording) -> None:
    assert repr(run).startswith("<Recording of two_link: case1, piddtsm, 2 s, RMSE 0.14")
    assert repr(run).endswith(" rad>")
    foreign = replace(run, robot={}, scenario=None, law=None, slides=(True, False))
    assert repr(foreign).startswith("<Recording of unknown arm: None, None, 2 s, RMSE 0.14")
    assert " m, " in repr(foreign)


def test_two_runs_are_drawn_over_each_other(run: Recording) -> None:
    figure = run.plot()
    assert len(figure.axes) == 6
    assert figure.axes[5].get_ylabel() == "effort [N m]"
    lines = len(figure.axes[0].lines)
    assert replace(run, law="pid").plot(figure) is figure
    assert len(figure.axes[0].lines) == 2 * lines
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["piddtsm", "pid"]
    with pytest.raises(ValueError, match="6 axes; this run needs 9"):
        replace(run, joints=("a", "b", "c")).plot(figure)


@pytest.mark.parametrize(
    ("method", "package"), [("plot", "matplotlib"), ("to_pandas", "pandas"), ("to_xarray", "xarray")]
)
def test_what_is_not_installed_is_named(
    run: Recording, monkeypatch: pytest.MonkeyPatch, method: str, package: str
) -> None:
    for module in (package, f"{package}.pyplot"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=f"^this needs {package}: python -m pip install {package}$"):
        getattr(run, method)()


def test_a_rollout_knows_scenario_law_event_and_duration() -> None:
    run = rollout("case2", law="pid", duration=0.2, simulator={"payload": {"time": 0.1}})
    assert (run.scenario, run.law, run.event_time, run.duration) == ("case2", "pid", 0.1, 0.2)
    assert "recovery_time" in run.metrics()


def test_an_experiment_can_be_varied() -> None:
    experiment = make_experiment("case2", law="pid", duration=0.1)
    varied = rollout(experiment, controller={"law.kp": 300.0})
    assert (varied.scenario, varied.law) == ("case2", "pid")
    named = rollout("case2", law="pid", duration=0.1, controller={"law": {"kp": 300.0}})
    np.testing.assert_array_equal(varied.effort, named.effort)
    assert not np.array_equal(varied.effort, rollout(experiment).effort)
    assert "law.kp" not in experiment.settings["controller"]


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UsageError, match="no scenario case9"):
        rollout("case9")
    with pytest.raises(UsageError, match="unknown node sensor"):
        make_experiment("case1", overrides={"sensor": {}})


def test_a_controller_in_a_loop_of_ones_own_does_the_same(run: Recording) -> None:
    controller = make_controller("case1")
    for k in range(200):
        controller.position[:], controller.reference[:] = run.position[k], run.reference[k]
        controller.step(k * 1_000_000, k * 1_000_000)
        np.testing.assert_array_equal(controller.effort, run.commanded_effort[k])
