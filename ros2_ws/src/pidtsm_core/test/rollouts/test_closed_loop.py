"""The closed loop: the numbers of the article's cases, and for any number of joints determinism and events."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.testarms import TWO_LINK, Arm

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.experiment import Experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import metrics
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status
from pidtsm_core.simulation.plant import Plant, plant_schema
from pidtsm_core.timing import period_nanoseconds, seconds

ARTICLE = {
    "estimator.name": "exact",
    "law.upsilon": 0.01,
    "law.u_s": 5.0,
    "law.xi": 0.01,
    "law.anti_windup": "none",
}
# RMSE (rad) and ECI (N m) of an independent program, written from the article's equations without this package: ideal
# q' and q'', torque held over RK4 steps of 1 ms, explicit Euler for the states of the law after the torque.
INDEPENDENT_RMSE = {"case1": (0.037988, 0.008597), "case2": (0.037989, 0.008598), "conditional": (0.038091, 0.008602)}
INDEPENDENT_ECI = (31.189, 12.025)
CASE_2 = {"payload.mass": 0.5, "payload.time": 15.0}


def measured(run: Recording) -> dict[str, list[Any]]:
    return metrics(
        run.time, run.position - run.reference[:, 0], run.effort, run.signals[:, Signal.SATURATED], event_time=None
    )


@pytest.mark.parametrize(
    ("controller", "simulator", "rmse"),
    [
        (ARTICLE, {}, INDEPENDENT_RMSE["case1"]),
        (ARTICLE, CASE_2, INDEPENDENT_RMSE["case2"]),
        ({**ARTICLE, "law.anti_windup": "conditional"}, {}, INDEPENDENT_RMSE["conditional"]),
    ],
    ids=["case1", "case2", "case1-conditional"],
)
def test_errors_are_those_of_an_independent_simulation(
    controller: dict[str, Any], simulator: dict[str, Any], rmse: tuple[float, float]
) -> None:
    run = rollout(controller=controller, simulator=simulator, duration=30.0)
    assert measured(run)["rmse"] == pytest.approx(rmse, abs=1e-5)


@pytest.fixture(scope="module")
def default_run() -> Recording:
    return rollout(duration=30.0)


def test_defaults_do_as_well_without_measured_derivatives(default_run: Recording) -> None:
    found = measured(default_run)
    # Around the article's RMSE, 0.03808 and 0.00889 rad, and within its steady-state errors.
    assert 0.0376 <= found["rmse"][0] <= 0.0385
    assert 0.0083 <= found["rmse"][1] <= 0.0093
    assert found["steady_state_error"][0] <= 7e-4
    assert found["steady_state_error"][1] <= 2e-5
    assert found["eci"] == pytest.approx(INDEPENDENT_ECI, rel=0.01)
    assert default_run.signals[-1, Signal.ADAPTIVE_GAIN].max() <= 20.0


def test_the_loop_is_deterministic(default_run: Recording) -> None:
    assert_same(rollout(duration=30.0), default_run)


def test_rows_belong_together(default_run: Recording) -> None:
    run = default_run
    assert len(run.time) == 30_000
    assert run.time[1234] == 1.234
    assert run.joints == ("joint1", "joint2")
    np.testing.assert_array_equal(run.position[0], [0.0, -0.1])
    np.testing.assert_array_equal(run.velocity[0], 0.0)
    np.testing.assert_array_equal(run.effort, run.signals[:, Signal.EFFORT])
    np.testing.assert_array_equal(run.position, run.signals[:, Signal.POSITION])
    np.testing.assert_allclose(np.diff(run.position, axis=0) / 0.001, run.velocity[:-1], atol=0.1)
    assert (np.abs(run.effort) <= [100.0, 50.0]).all()


def events(arm: Arm) -> dict[str, Any]:
    """Many different events within two seconds."""
    settings = arm.motion()
    push = arm.effort(arm.start, ddq=arm.alternating(15.0)) - arm.effort(arm.start)
    settings["controller"] |= {
        "limits.effort_rate": (10.0 * arm.limits).tolist(),
        "limits.tracking_error": 0.1,
        "activation.blend": 0.8,
        "rehearsal.reset_fault": 1.3,
        "rehearsal.restart": 1.8,
        "rehearsal.freedrive": 1.65,
        "rehearsal.hold": 1.7,
        "rehearsal.follow": 1.75,
    }
    settings["simulator"] |= {"push.effort": push.tolist(), "push.time": 0.3, "push.duration": 0.3}
    settings["trajectory"] |= {
        "dropout.time": 1.4,
        "dropout.duration": 0.2,
        "jump.position": arm.alternating(0.05).tolist(),
        "jump.time": 1.9,
        "feedforward.effort": (0.02 * arm.limits).tolist(),
    }
    return settings


def stepped_as_the_nodes_do(arm: Arm, settings: dict[str, dict[str, Any]], samples: int, rate: int = 1000) -> Recording:
    """A rollout of the same parts, each called as in its node."""
    period, n = period_nanoseconds(rate), arm.joints
    controller = Controller(
        arm.values(controller_schema, {**MEASUREMENT.defaults["controller"], **settings["controller"]})
    )
    plant = Plant(arm.values(plant_schema, settings["simulator"]))
    motion = ReferenceMotion(resolve(reference_schema, {"joints": arm.names, **settings["trajectory"]}, n))
    made = Recording(
        joints=tuple(arm.names),
        time=np.empty(samples),
        position=np.empty((samples, n)),
        velocity=np.empty((samples, n)),
        effort=np.empty((samples, n)),
        reference=np.empty((samples, 3, n)),
        signals=np.empty((samples, len(Signal), n)),
        status=np.empty((samples, len(Status)), dtype=np.uint8),
        stamps_ns=np.arange(samples) * period,
        compute_time=np.empty(0),
        scenario=None,
        law=None,
        clock=None,
        event_time=None,
    )
    referred = -1
    for k in range(samples):
        stamp = k * period
        made.time[k] = seconds(stamp)
        made.position[k], made.velocity[k] = plant.state.position, plant.state.derivatives[0]
        motion.evaluate(seconds(stamp), made.reference[k])
        if not motion.drops_out(seconds(stamp)):
            controller.reference[:], controller.given[3] = made.reference[k], motion.config.feedforward
            referred = stamp
        controller.position[:] = plant.state.position
        made.status[k] = controller.step(stamp, referred)
        made.signals[k] = controller.signals
        plant.step(controller.effort, seconds(stamp), seconds(period))
        made.effort[k] = plant.state.effort
    return made


def assert_same(run: Recording, other: Recording) -> None:
    """Compare bit by bit."""
    assert run.joints == other.joints
    for name in ("time", "position", "velocity", "effort", "reference", "signals", "status"):
        np.testing.assert_array_equal(getattr(run, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("law", LAWS.names)
@pytest.mark.parametrize("rate", [1000, 300])
def test_stepping_the_parts_as_the_nodes_do_gives_the_same_bits(arm: Arm, law: str, rate: int) -> None:
    settings = arm.motion()
    settings["controller"]["law.name"] = law
    settings["simulator"] |= {"rate": rate, **CASE_2, "payload.time": 0.2}
    run = rollout(**settings, duration=600 * period_nanoseconds(rate) / 1e9)
    assert_same(run, stepped_as_the_nodes_do(arm, settings, 600, rate))


def test_stepping_the_parts_through_faults_and_limits_gives_the_same_bits(arm: Arm) -> None:
    settings = events(arm)
    run = rollout(**settings, duration=2.0)
    assert set(run.status[:, Status.MODE]) == set(Mode)
    assert (run.signals[:, Signal.SATURATED] >= Limited.RATE).any()
    assert set(run.status[:, Status.FAULT]) == {Fault.NO_FAULT, Fault.TRACKING_LIMIT}
    assert run.status[-1, Status.FAULT] == Fault.NO_FAULT
    assert_same(run, stepped_as_the_nodes_do(arm, settings, 2000))


SINES = {"reference.name": "sines", "reference.amplitude": [0.2, 0.1], "reference.frequency": [0.5, 0.8]}


def reversed_joints(settings: dict[str, Any], arm: Arm) -> dict[str, Any]:
    """Settings with the joints in the opposite order."""
    turned = {name: value[::-1] if isinstance(value, list) else value for name, value in settings.items()}
    return {**turned, "joints": arm.names[::-1]}


@pytest.mark.parametrize("node", ["controller", "trajectory", "controller and trajectory"])
def test_joints_are_matched_by_name_in_any_order(arm: Arm, node: str) -> None:
    """The law has no model, because a closed form has an order of its own."""
    settings = arm.motion()
    settings["controller"] |= {"law.name": "pid", **arm.gains("pid"), "limits.effort": arm.limits.tolist()}
    settings["trajectory"] = settings["trajectory"] or SINES
    permuted: dict[str, Any] = {
        name: reversed_joints(given, arm) if name in node else {**given, "joints": arm.names}
        for name, given in settings.items()
    }
    assert_same(rollout(**permuted, duration=1.0), rollout(**settings, duration=1.0))


def test_joints_may_have_any_names_and_the_trajectory_takes_those_of_the_controller() -> None:
    joints = {"joints": ["shoulder", "elbow"]}
    run = rollout(controller=joints, simulator=joints, trajectory=SINES, duration=0.5)
    assert run.joints == ("shoulder", "elbow")
    assert_same(replace(run, joints=("joint1", "joint2")), rollout(trajectory=SINES, duration=0.5))


@pytest.mark.parametrize("node", ["simulator", "trajectory"])
def test_nodes_with_other_joints_are_refused_by_name(node: str) -> None:
    reason = f"^{node}: joints are joint1, elbow; those of the controller are joint1, joint2"
    with pytest.raises(ParameterError, match=reason) as refused:
        rollout(Experiment("", "", 0.01, {node: {"joints": ["joint1", "elbow"]}}))
    assert refused.value.parameter == f"{node}.joints"


def settled_error(run: Recording, since: float) -> float:
    """Largest |e| from `since` (s) on, rad."""
    return float(np.abs(run.position - run.reference[:, 0])[run.time >= since].max())


def test_an_arm_that_is_led_to_its_reference_settles_as_well(arm: Arm) -> None:
    settings = arm.motion()
    settings["controller"]["activation.blend"] = 0.8
    settled = 10.0 if arm is TWO_LINK else 5.0
    assert settled_error(rollout(**settings, duration=settled + 2.0), settled) <= 1e-4


def test_the_arm_holds_its_position_while_references_are_missing(arm: Arm) -> None:
    settings = arm.motion()
    settings["trajectory"] |= {"dropout.time": 1.0, "dropout.duration": 0.5}
    run = rollout(**settings, duration=8.0)
    # The last reference has the stamp 0.999 s and is followed until watchdog.reference has passed.
    held = np.flatnonzero(run.status[:, Status.MODE] == Mode.HOLDING)
    np.testing.assert_array_equal(held, np.arange(1100, 1500))
    assert not run.status[:, Status.FAULT].any()
    assert np.abs(run.velocity[1400:1500]).max() < 0.1 * np.abs(run.reference[1400:1500, 1]).max()
    assert settled_error(run, 5.0 if arm is TWO_LINK else 6.0) < 1e-3


def test_a_reference_that_jumps_is_followed(arm: Arm) -> None:
    smooth, jumping, jump = arm.motion(), arm.motion(), arm.alternating(0.1)
    jumping["trajectory"] |= {"jump.position": jump.tolist(), "jump.time": 1.0}
    settled = 8.0 if arm is TWO_LINK else 6.0
    run, plain = rollout(**jumping, duration=settled + 2.0), rollout(**smooth, duration=settled + 2.0)
    np.testing.assert_array_equal(run.reference[:1000], plain.reference[:1000])
    jumped = run.reference[1000:, 0] - plain.reference[1000:, 0]
    np.testing.assert_allclose(jumped, np.broadcast_to(jump, jumped.shape), rtol=1e-12)
    np.testing.assert_array_equal(run.reference[:, 1:], plain.reference[:, 1:])
    assert (run.status[:, Status.MODE] == Mode.FOLLOWING).all()
    assert settled_error(run, settled) < 1e-3


def test_a_rehearsed_restart_is_equivalent_to_a_real_one(arm: Arm) -> None:
    """From then on, a new controller does the same; only the earlier references differ."""
    settings = arm.motion()
    settings["controller"] |= {"rehearsal.restart": 0.5, "activation.blend": 0.8}
    run = rollout(**settings, duration=1.0)
    controller = arm.controller(watchdog__state_stop=1.0)
    for k in range(500, 1000):
        controller.position[:], controller.reference[:] = run.position[k], run.reference[k]
        controller.step(k * 1_000_000, k * 1_000_000)
        np.testing.assert_array_equal(controller.signals, run.signals[k], err_msg=str(k))


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"contoller": {}}, "unknown node contoller"),
        ({"controller": {"law.k9": 1.0}}, r"controller: .*law\.k9"),
        ({"simulator": {"payload.mas": 1.0}}, r"simulator: .*did you mean payload\.mass"),
        ({"trajectory": {"reference.speed": 1.0}}, r"trajectory: .*reference\.speed"),
        ({"controller": {"law.k1": -1.0}}, r"controller: law\.k1"),
        ({"controller": {"law.name": "piddtms"}}, r"controller: law\.name.*did you mean piddtsm"),
        ({"simulator": {"robot.description": "two_lnk"}}, r"simulator: robot\.description.*did you mean two_link"),
        (
            {"controller": {"robot.description": "panda"}, "simulator": {"robot.description": "panda"}},
            r"trajectory: reference\.name: this reference moves 2 joints, and the robot has 7",
        ),
        ({"controller": {"robot.description": "two_lnk"}}, r"controller: robot\.description.*did you mean two_link"),
        ({"simulator": {"initial_position": [0.0, 1.0, 2.0]}}, r"simulator: initial_position.*2 joints"),
    ],
)
def test_invalid_settings_are_refused_with_the_name_of_the_node(settings: Any, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        rollout(Experiment("", "", 0.01, settings))


@pytest.mark.parametrize("duration", [0.0, 0.0004, -1.0, float("nan"), float("inf")])
def test_a_duration_without_samples_or_end_is_refused(duration: float) -> None:
    with pytest.raises(ParameterError, match="duration"):
        rollout(duration=duration)


def test_a_rollout_that_does_not_fit_in_memory_is_refused_with_its_size() -> None:
    with pytest.raises(ParameterError, match=r"duration: .*1000000000000 samples takes [\d.e+]+ GB of memory"):
        rollout(duration=1e9)


def test_a_start_far_from_the_reference_is_refused_as_activation_is() -> None:
    with pytest.raises(ParameterError, match=r"joint1 is .* rad from its reference"):
        rollout(simulator={"initial_position": [2.0, -0.1]}, duration=0.1)
    rollout(simulator={"initial_position": [2.0, -0.1]}, controller={"activation.distance": 3.0}, duration=0.1)


def test_one_sample_is_a_run() -> None:
    run = rollout(duration=0.001)
    assert run.time.tolist() == [0.0]


def test_the_error_of_a_diverging_loop_includes_the_time() -> None:
    # One second between samples, and almost no torque.
    weak: dict[str, Any] = {"limits.effort": 1e-3}
    with pytest.raises(DivergedError, match=r"after \d+(\.\d+)? s"):
        rollout(controller=weak, simulator={**weak, "rate": 1}, duration=1000.0)
