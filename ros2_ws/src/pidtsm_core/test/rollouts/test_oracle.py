"""The oracle follows where no controller does, within the limits of the arm, on whatever hardware."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.rollouts.oracle import ERRORS, oracle


def run(arm: str, hardware: str | None, duration: float = 6.0, **simulator: Any) -> Recording:
    changed = {"simulator": {name.replace("__", "."): value for name, value in simulator.items()}}
    return oracle(make_experiment(None, robot=arm, hardware=hardware, overrides=changed), duration=duration)


def late(found: Recording) -> float:
    return float(np.abs(found.error[found.time >= 4.0]).max())


@pytest.mark.parametrize("hardware", hardware_names())
def test_it_follows_on_every_class_better_than_the_rule_by_far(hardware: str) -> None:
    made = make_experiment(None, robot="panda", hardware=hardware)
    best = min(late(oracle(made, error=error, duration=6.0)) for error in ERRORS)
    assert best < 1e-3
    assert best < 0.2 * late(rollout(made, duration=6.0))


def test_what_a_sensor_does_not_tell_and_a_model_does_not_know_change_nothing() -> None:
    seen = {"noise__std": 1e-2, "delay__samples": 50, "dropout__probability": 0.9, "encoder__bits": 6}
    assert run("ur5", None, 1.0, **seen).effort.tobytes() == run("ur5", None, 1.0).effort.tobytes()
    other = {"model_error__mass": 0.5, "model_error__inertia": 0.5, "payload__mass": 3.0, "payload__time": 2.0}
    assert late(run("ur5", None, **other)) < 1e-3


def test_its_torque_is_within_the_limits_of_the_arm() -> None:
    made = make_experiment(None, robot="panda", overrides={"simulator": {"limits.effort": 20.0}})
    found = oracle(made, duration=2.0)
    assert np.abs(found.effort).max() == pytest.approx(20.0)
    assert np.abs(found.commanded_effort).max() <= 20.0


def test_a_smooth_one_is_smoother_and_follows_less_well() -> None:
    made = make_experiment(None, robot="panda", overrides={"simulator": {"actuator.noise": 1.0}})
    runs = [oracle(made, error=error, duration=4.0) for error in ERRORS]
    rough = [np.abs(np.diff(each.commanded_effort, axis=0)).mean() for each in runs]
    assert rough == sorted(rough, reverse=True)


def test_what_it_commands_moves_a_joint_as_the_equation_of_motion_says() -> None:
    """SciPy, with the closed form of one joint: a rotor that a lagging drive turns."""
    changes: dict[str, dict[str, Any]] = {
        "simulator": {"actuator.lag": 0.02},
        "trajectory": {"reference.amplitude": [0.2, 0.0, 0.0, 0.0]},
    }
    made = make_experiment(None, robot="scara", overrides=changes)
    offset = np.array(made.settings["trajectory"]["reference.offset"])
    begin = {"simulator": {"initial_position": (offset - [0.2, 0.0, 0.0, 0.0]).tolist()}}
    found = oracle(make_experiment(made, overrides=begin), duration=2.0)
    assert np.abs(found.error[:, 0]).max() < 1e-4
    # The drives need a torque that leads that of the motion by the lag.
    torque = solve_ivp(
        lambda t, x: (np.interp(t, found.time, found.commanded_effort[:, 0]) - x) / 0.02,
        (0.0, 1.9),
        found.effort[0, :1],
        t_eval=found.time[:1900],
        max_step=1e-3,
    ).y[0]
    scale = np.abs(found.effort[:, 0]).max()
    np.testing.assert_allclose(torque[500:], found.effort[500:1900, 0], atol=0.02 * scale)
