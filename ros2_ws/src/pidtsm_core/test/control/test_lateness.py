"""Drives that are late: what is known of it keeps the arm on its reference, and makes nothing worse.

The judges are the simulated arm, whose drives are known, and SciPy.
"""

from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete
from support.coreloop import PERIOD, CoreLoop

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.experiment import make_experiment
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Request, Signal, Status

DELAY, LAG = "drive.delay", "drive.lag"
LATE = [
    ({"delay.samples": 60}, {DELAY: 0.06}),
    ({"actuator.lag": 0.1}, {LAG: 0.1}),
    ({"delay.samples": 30, "actuator.lag": 0.05}, {DELAY: 0.03, LAG: 0.05}),
]
REAL = {"encoder.bits": 14}


def run(simulator: dict[str, Any], controller: dict[str, Any], robot: str = "panda", seconds: float = 6.0) -> Recording:
    given = {**REAL, **simulator}
    return rollout(params="practical", robot=robot, duration=seconds, controller=controller, simulator=given)


def late_error(run: Recording) -> float:
    """Largest error in the last quarter of the run, rad."""
    errors: Array = np.abs(run.position - run.reference[:, 0])
    return float(errors[errors.shape[0] * 3 // 4 :].max())


def largest_step(run: Recording) -> float:
    """Largest change of the effort on the arm from one sample to the next, N m, after the beginning."""
    return float(np.abs(np.diff(run.effort[200:], axis=0)).max())


@pytest.mark.parametrize("robot", ["panda", "xarm7"])
@pytest.mark.parametrize(("simulator", "known"), LATE)
def test_known_lateness_costs_no_accuracy(robot: str, simulator: dict[str, Any], known: dict[str, Any]) -> None:
    assert late_error(run(simulator, known, robot)) < 3e-3
    assert late_error(run(simulator, {}, robot)) > 2e-2


@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
@pytest.mark.parametrize(("simulator", "known"), [({"delay.samples": 30}, {DELAY: 0.03}), LATE[1]])
def test_what_is_known_may_be_wrong_by_a_third(share: float, simulator: dict[str, Any], known: dict[str, Any]) -> None:
    # One error depends on the last bits, and so on the processor: for the longest lag it goes from 1.4e-3 to 2.3e-3.
    known = {name: share * value for name, value in known.items()}
    pushes = ({"push.force": [1e-9 * k, 0.0, 0.0], "push.time": 1.0, "push.duration": 1.0} for k in range(7))
    assert np.median([late_error(run({**simulator, **push}, known)) for push in pushes]) < 2e-3


@pytest.mark.parametrize("known", [{DELAY: 0.01}, {LAG: 0.01}])
def test_an_arm_that_is_not_late_stays_about_as_good(known: dict[str, Any]) -> None:
    assert late_error(run({}, known)) < 2.0 * late_error(run({}, {}))


@pytest.mark.parametrize("law", [law.name for law in LAWS.members if law.uses_model])
def test_every_law_with_a_model_profits(law: str) -> None:
    simulator, known = {"delay.samples": 15, "actuator.lag": 0.03}, {DELAY: 0.015, LAG: 0.03}
    make = {"params": "practical", "robot": "panda", "duration": 6.0, "law": law, "simulator": simulator}
    assert late_error(rollout(**make, controller=known)) < 0.5 * late_error(rollout(**make))  # type: ignore[arg-type]


@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.03), (0.02, 0.0), (0.0205, 0.04)])
def test_what_the_drives_deliver_is_what_scipy_says(delay: float, lag: float) -> None:
    """Mean over a period of the lagged command; a delay of half a period is the mean of two."""
    loop = CoreLoop("panda", {DELAY: delay, LAG: lag, "limits.effort_rate": 500.0}, REAL)
    commands = loop.advance(600)
    delivered = loop.delivered
    mean = commands
    if lag > 0.0:
        # Effort, and its integral, from command.
        a, b = np.array([[-1.0 / lag, 0.0], [1.0, 0.0]]), np.array([[1.0 / lag], [0.0]])
        ad, bd, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), PERIOD)
        x, mean = np.stack([commands[0], np.zeros(7)]), np.empty_like(commands)
        for k, command in enumerate(commands):
            x[1] = 0.0
            x = ad @ x + bd * command
            mean[k] = x[1] / PERIOD
    whole, part = divmod(round(delay / PERIOD, 6), 1.0)
    first = int(whole) + 2
    # At sample k, what acted over the last period was commanded at k - 1 - delay.
    expected = (1.0 - part) * mean[first - 1 - int(whole) : -1 - int(whole)]
    expected += part * mean[first - 2 - int(whole) : -2 - int(whole)]
    np.testing.assert_allclose(delivered[first:], expected, atol=1e-9)


@pytest.mark.parametrize(("simulator", "known"), LATE)
def test_commands_keep_their_limits(simulator: dict[str, Any], known: dict[str, Any]) -> None:
    limited = run(simulator, {**known, "limits.effort_rate": 1000.0, "limits.effort": [87.0] * 4 + [12.0] * 3})
    assert limited.status[-1, Status.FAULT] == 0
    assert late_error(limited) < 2e-3
    assert np.all(np.abs(limited.signals[:, Signal.EFFORT]) <= [87.0] * 4 + [12.0] * 3)
    assert np.abs(np.diff(limited.signals[200:, Signal.EFFORT], axis=0)).max() <= 1.0 + 1e-9


@pytest.mark.parametrize("robot", ["panda", "ur5"])
@pytest.mark.parametrize(("simulator", "known"), LATE)
def test_a_stopped_arm_that_is_late_rests(robot: str, simulator: dict[str, Any], known: dict[str, Any]) -> None:
    stopped = run(simulator, {**known, "limits.velocity": 0.1}, robot)
    assert stopped.status[-1, Status.FAULT] == Fault.VELOCITY_LIMIT
    assert np.ptp(stopped.position[-1000:], axis=0).max() < 5e-3


@pytest.mark.parametrize(
    "interrupted",
    [
        {"rehearsal.hold": 2.0, "rehearsal.follow": 3.0},
        {"rehearsal.freedrive": 2.0, "rehearsal.follow": 3.0},
        {"feedback.effort": "measured"},
        {"adaptation.friction": "learn"},
    ],
)
@pytest.mark.parametrize(("simulator", "known"), [({"delay.samples": 10}, {DELAY: 0.01}), LATE[1], LATE[2]])
def test_what_else_the_controller_does_still_works(
    interrupted: dict[str, Any], simulator: dict[str, Any], known: dict[str, Any]
) -> None:
    found = run(simulator, {**known, **interrupted})
    assert found.status[-1, Status.FAULT] == 0
    assert late_error(found) < 0.02
    assert largest_step(found) < 5.0


@pytest.mark.parametrize(("late", "refused"), [({DELAY: 0.03}, True), ({LAG: 0.05}, False), ({LAG: 0.1}, True)])
def test_freedrive_is_refused_where_the_drives_are_too_late(late: dict[str, Any], refused: bool) -> None:
    loop = CoreLoop("panda", late, REAL)
    loop.advance(20)
    answer = loop.controller.request(Request.FREE)
    assert ("late (drive.delay + drive.lag / drive.inversion)" in answer) == refused


@pytest.mark.parametrize(
    ("simulator", "known"), [({"delay.samples": 10}, {DELAY: 0.01}), ({"actuator.lag": 0.02}, {LAG: 0.02})]
)
def test_what_is_known_can_change_while_the_arm_moves(simulator: dict[str, Any], known: dict[str, Any]) -> None:
    loop = CoreLoop("panda", {}, {**REAL, **simulator})
    nothing: dict[str, Any] = {DELAY: 0.0, LAG: (0.0,) * 7}
    schema, given = controller_schema, dict(loop.values)
    efforts = [loop.advance(1000)]
    for change in (known, nothing, known):
        given |= nothing | change
        loop.controller.set_parameters(resolve(schema, given, 7))
        efforts.append(loop.advance(1000))
    steps = np.abs(np.diff(np.concatenate(efforts)[200:], axis=0)).max()
    assert steps < 5.0
    assert loop.controller.fault == 0
    assert np.abs(loop.controller.signals[Signal.POSITION_ERROR]).max() < 2e-3


def test_lateness_needs_the_observer_and_a_model() -> None:
    values = make_experiment("case1").values["controller"]
    with pytest.raises(ParameterError, match=r"drive\.delay: estimator\.name must be elastic_joint_observer or"):
        resolve(controller_schema, {**values, DELAY: 0.01}, 2)
    assert DELAY not in {p.name for p in controller_schema({"law.name": "pid"})}
