"""Members from outside: registered, refused with a reason, replaced, and sent to workers."""

import math
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from typing import Any

import joblib
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.registered import forget

import pidtsm_core as pidtsm
from pidtsm_core.arrays import Array
from pidtsm_core.errors import MemberWarning
from pidtsm_core.laws import LAWS, Demand
from pidtsm_core.laws.computed_torque import COMPUTED_TORQUE
from pidtsm_core.parameters import family as families
from pidtsm_core.parameters.family import Family
from pidtsm_core.registration import FAMILIES
from pidtsm_core.robots.two_link import TWO_LINK

GAIN = pidtsm.Parameter("kp", 100.0, "gain", "1/s^2", minimum=0.0, per_joint=True)
DAMPING = pidtsm.Parameter("kd", 20.0, "gain", "1/s", minimum=0.0, per_joint=True)


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    """Each test has only the members that it registers."""
    yield
    forget()


def proportional(e: float, de: float, dde: float, ddq_d: float, p: Array, x: Array, dt: float) -> float:
    """The formula of `computed_torque`."""
    return ddq_d - p[1] * de - p[0] * e


def cubic(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    return de + p[0] * e + p[1] * e**3, 1.0, (p[0] + 3.0 * p[1] * e**2) * de


CUBIC = pidtsm.Surface(
    "cubic", "e' + a e + b e^3", (pidtsm.Parameter("a", 3.0, "a"), pidtsm.Parameter("b", 1.0, "b")), cubic
)


def test_a_law_from_a_python_function_computes_the_bits_of_ours() -> None:
    pidtsm.register(pidtsm.own_law("proportional", "inverse dynamics with PD", proportional, (GAIN, DAMPING)))
    for robot in ("two_link", "panda"):
        theirs, ours = (
            pidtsm.rollout(law=law, robot=robot, duration=0.5) for law in ("proportional", "computed_torque")
        )
        np.testing.assert_array_equal(theirs.position, ours.position)
    changed = pidtsm.rollout(law="proportional", duration=0.5, controller={"law.kp": [50.0, 60.0]})
    assert np.abs(changed.position - ours.position[:, :2]).max() > 1e-4
    with pytest.raises(pidtsm.ParameterError, match=r"law\.kp"):
        pidtsm.rollout(law="proportional", duration=0.5, controller={"law.kp": -1.0})


def of_all_joints(arm: Any, p: Array, x: Array, demand: Array) -> None:
    for j in range(p.shape[0]):
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        demand[Demand.ACCELERATION, j] = arm.desired[2, j] - p[j, 1] * de - p[j, 0] * e


def nothing(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """Of a law without memory."""


def arm_law(command: Any) -> pidtsm.Law:
    return pidtsm.arm_law("of_all_joints", "", (GAIN, DAMPING), command, nothing, lambda joints: joints)


def test_a_law_of_the_whole_arm_from_python_functions_computes_the_bits_of_the_same_law_of_each_joint() -> None:
    pidtsm.register(arm_law(of_all_joints))
    theirs, ours = (
        pidtsm.rollout(law=law, robot="panda", duration=0.5) for law in ("of_all_joints", "computed_torque")
    )
    np.testing.assert_array_equal(theirs.position, ours.position)


def spoils(arm: Any, p: Array, x: Array, demand: Array) -> None:
    demand[Demand.EFFORT, 0] = 1.0 / arm.motion[0, 0]


def misspelt(arm: Any, p: Array, x: Array, demand: Array) -> None:
    demand[Demand.EFFORT, 0] = arm.position[0]


def test_the_memory_of_a_law_pauses_while_its_torque_is_limited() -> None:
    def formula(e: float, de: float, dde: float, ddq_d: float, p: Array, x: Array, dt: float) -> float:
        return ddq_d - 100.0 * e - 20.0 * de - 200.0 * x[0]

    def memory(e: float, p: Array, x: Array, dt: float) -> None:
        x[0] += dt * e

    pidtsm.register(pidtsm.own_law("with_integral", "", formula, memory=memory))
    pushed = {"push.effort": [100.0, 50.0], "push.time": 1.0, "push.duration": 1.0}
    overshoot = []
    for windup in ("conditional", "none"):
        run = pidtsm.rollout(
            law="with_integral", duration=4.0, controller={"law.anti_windup": windup}, simulator=pushed
        )
        overshoot.append(np.abs(run.error[run.time > 2.5]).max())
    assert overshoot[0] < 0.8 * overshoot[1]


def test_a_surface_makes_a_law_that_slides_on_it() -> None:
    """On s = 0, the error follows e' = -a e - b e^3, as SciPy integrates it."""
    pidtsm.register(CUBIC, pidtsm.compose("on_cubic", "", surface="cubic", manifold="none", reaching="boundary_layer"))
    run = pidtsm.rollout(
        law="on_cubic", duration=3.0, simulator={"disturbance.name": "none"}, controller={"law.b": 8.0}
    )
    begin = int(np.flatnonzero(np.abs(run.sliding_variable[:, 0]) < 1e-3)[0]) + 100
    times, expected = run.time[begin:], run.error[begin, :1]
    found = solve_ivp(lambda _, e: -3.0 * e - 8.0 * e**3, (times[0], times[-1]), expected, t_eval=times, rtol=1e-9)
    assert np.abs(run.error[begin:, 0] - found.y[0]).max() < 0.05 * abs(expected[0]) + 1e-3


def test_a_reference_and_a_disturbance_may_be_python_functions_of_time() -> None:
    pidtsm.register(
        pidtsm.sampled_reference("wave", "", lambda t: [0.3 * math.sin(t), 0.2 * math.cos(2.0 * t)], 5.0),
        pidtsm.sampled_disturbance("hum", "", lambda t: np.array([3.0 * math.sin(20.0 * t), 1.0]), 5.0),
    )
    start = {"initial_position": [0.0, 0.2]}
    chosen: dict[str, Any] = {"law": "computed_torque", "duration": 2.0, "trajectory": {"reference.name": "wave"}}
    run = pidtsm.rollout(**chosen, simulator={**start, "disturbance.name": "hum"})
    t = run.time[:, np.newaxis]
    np.testing.assert_allclose(run.reference[:, 0], np.hstack([0.3 * np.sin(t), 0.2 * np.cos(2.0 * t)]), atol=1e-7)
    np.testing.assert_allclose(run.reference[:, 2], np.hstack([-0.3 * np.sin(t), -0.8 * np.cos(2.0 * t)]), atol=1e-3)
    calm = pidtsm.rollout(**chosen, simulator={**start, "disturbance.name": "none"})
    pushed = run.effort - calm.effort
    assert np.abs(pushed).max() > 0.3
    assert np.abs(run.position - calm.position).max() > 1e-3


@pytest.mark.parametrize(
    "engine", [{}, {"engine": "mujoco"}, {"elasticity.stiffness": 1e5}], ids=["rigid", "mujoco", "elastic"]
)
def test_a_disturbance_knows_the_time_and_its_parameters_in_every_plant(engine: dict[str, Any]) -> None:
    """Its impulse on an arm without gravity: 1 N m for 0.1 s, from 0.2 s on."""

    def pulse(t: float, q: Array, dq: Array, p: Array, effort: Array) -> None:
        if 0.2 <= t < 0.3:
            for j in range(effort.size):
                effort[j] += p[j, 0]

    pidtsm.register(
        pidtsm.Disturbance("pulse", "", (pidtsm.Parameter("size", 1.0, "torque", "N m", per_joint=True),), 0, pulse)
    )
    free = {"robot.coriolis": "lagrange", "robot.g": 0.0, "limits.effort": 1e-6, "disturbance.name": "pulse", **engine}
    run = pidtsm.rollout(law="pid", duration=0.5, simulator={**free, "disturbance.size": [2.0, -1.0]})
    assert np.abs(run.velocity[run.time < 0.199]).max() < 1e-5
    inertia = TWO_LINK.inertia_matrix(
        TWO_LINK.pack_model({f"robot.{each.name}": each.default for each in TWO_LINK.parameters}), run.position[200]
    )
    impulse = inertia @ run.velocity[run.time > 0.31].mean(axis=0)  # Springs swing faster than that.
    np.testing.assert_allclose(impulse, [0.2, -0.1], rtol=0.03)


def test_a_closed_form_of_an_arm_is_found_by_its_name() -> None:
    dynamics = replace(TWO_LINK.dynamics, energy=lambda q, dq, p: 0.0)
    pidtsm.register(replace(TWO_LINK, name="another_arm", dynamics=dynamics))
    outside = pidtsm.rollout(robot="another_arm", params="article", duration=0.5)
    ours = pidtsm.rollout(params="article", duration=0.5, trajectory={"reference.name": "article"})
    assert np.isfinite(outside.position).all()
    assert outside.position.shape == ours.position.shape


def wrong(result: str, arguments: str = "e, de, dde, ddq_d, p, x, dt") -> Any:
    """A function with this expression as its result."""
    names: dict[str, Any] = {"math": math, "np": np}
    exec(f"def formula({arguments}): return {result}", names)
    return names["formula"]


@pytest.mark.parametrize(
    ("member", "reason"),
    [
        (lambda: pidtsm.own_law("pid", "", proportional, (GAIN, DAMPING)), "pidtsm already has a Law of this name"),
        (lambda: pidtsm.own_law("my law", "", proportional, (GAIN, DAMPING)), "letters, digits and underscores only"),
        (lambda: pidtsm.own_law("lambda", "", proportional, (GAIN, DAMPING)), "letters, digits and underscores only"),
        (lambda: pidtsm.own_law("wrong", "", proportional, (GAIN, GAIN)), "'kp' occurs twice"),
        (
            lambda: pidtsm.own_law("wrong", "", wrong("e.missing")),
            "law wrong does not compile: Unknown attribute 'missing'",
        ),
        (lambda: pidtsm.own_law("wrong", "", wrong("nowhere * e")), "does not compile: NameError: name 'nowhere'"),
        (lambda: pidtsm.own_law("wrong", "", wrong("e", "e, de")), "too many positional arguments"),
        (lambda: pidtsm.own_law("wrong", "", wrong("(e, de)")), "it returns .* not 6 floats"),
        (lambda: pidtsm.own_law("wrong", "", wrong("np.zeros(3)[0]")), "creates an array"),
        (lambda: pidtsm.own_law("wrong", "", wrong("math.log(e)")), "returns .*inf.* for e = 0, e' = 0"),
        (lambda: pidtsm.own_law("wrong", "", refusing), "Law wrong raises ValueError: not at zero"),
        (lambda: arm_law(spoils), "law of_all_joints returns .*inf.* for e = 0"),
        (lambda: arm_law(misspelt), "law of_all_joints does not compile: .*position"),
        (lambda: pidtsm.compose("wrong", "", surface="nowhere"), "consists of 'nowhere', which is not known"),
        (
            lambda: pidtsm.Surface("wrong", "", (), lambda e, de, i, p: (de + 3.0 * e, 1.0, 2.0 * de)),
            "h is 0.4 .* is 0.6",
        ),
        (lambda: pidtsm.Surface("wrong", "", (), lambda e, de, i, p: (de + 3.0 * e, 2.0, 3.0 * de)), "g is 2 .* is 1"),
        (lambda: pidtsm.Surface("wrong", "", (), wrong("(de, 1.0)", "e, de, i, p")), "not 3 floats"),
        (lambda: pidtsm.ReachingLaw("wrong", "", (), lambda sigma, p, x, dt: (1.0 / sigma, 1.0)), "for sigma = 0"),
        (lambda: pidtsm.Disturbance("wrong", "", (), 2, lambda t, q, dq, p, effort: effort.fill(math.nan)), "nan"),
        (lambda: pidtsm.Reference("wrong", "", (), 1, slow), "q' of joint 1 is 0 .* derivative of its q is 1"),
        (lambda: 3, "3 cannot be registered: it must be one of Surface, ReachingLaw, Law"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason_and_nothing_changes(member: Any, reason: str) -> None:
    before = [family.members for family in FAMILIES]
    with pytest.raises(pidtsm.MemberError, match=reason):
        pidtsm.register(member())
    assert [family.members for family in FAMILIES] == before


def refusing(e: float, de: float, dde: float, ddq_d: float, p: Array, x: Array, dt: float) -> float:
    """A formula that raises an error."""
    if e == 0.0:
        raise ValueError("not at zero")
    return ddq_d / e


def slow(t: float, p: Array, desired: Array) -> None:
    """A reference whose derivative is not that of its position."""
    desired[0, 0], desired[1, 0], desired[2, 0] = t, 0.0, 0.0


@pytest.mark.parametrize(
    ("function", "duration"), [(lambda t: [math.nan], 1.0), (lambda t: [t] * (1 + int(t)), 2.0), (lambda t: [t], 0.0)]
)
def test_a_function_that_gives_no_motion_is_refused(function: Any, duration: float) -> None:
    with pytest.raises(pidtsm.MemberError, match="reference wrong"):
        pidtsm.sampled_reference("wrong", "", function, duration)


def test_a_cell_that_is_run_again_replaces_its_law() -> None:
    runs = []
    for gain in (100.0, 30.0, 100.0):
        law = pidtsm.own_law("again", "", wrong(f"ddq_d - 20.0 * de - {gain} * e"))
        pidtsm.register(law)
        runs.append(pidtsm.rollout(law="again", duration=0.3).position)
    assert np.abs(runs[1] - runs[0]).max() > 1e-4
    np.testing.assert_array_equal(runs[2], runs[0])


@pytest.mark.parametrize("backend", ["threading", "loky"])
def test_the_workers_of_a_batch_know_what_is_registered(backend: str) -> None:
    """Also in other processes, which import nothing of this module."""
    pidtsm.register(
        CUBIC, pidtsm.compose("on_cubic", "", surface="cubic", manifold="pid", reaching="adaptive_continuous")
    )
    pidtsm.register(pidtsm.sampled_disturbance("hum", "", lambda t: [3.0 * math.sin(20.0 * t), 1.0], 1.0))
    settings: list[dict[str, Any]] = [
        {"law": "on_cubic", "controller": {"law.b": b}, "simulator": {"disturbance.name": "hum"}} for b in (1.0, 2.0)
    ]
    here = [pidtsm.rollout(**each, duration=0.3).metrics()["rmse"] for each in settings]
    with joblib.parallel_config(backend=backend, n_jobs=2):
        result = pidtsm.batch(settings, 0.3, workers=2)
    assert result.failed == {}
    np.testing.assert_array_equal(result.metrics["rmse"], here)


def test_installed_packages_offer_members(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that cannot be used are skipped with a warning that names package and reason."""
    offers = {
        "good": pidtsm.own_law("offered", "", proportional, (GAIN, DAMPING)),
        "several": [pidtsm.own_law(name, "", proportional, (GAIN, DAMPING)) for name in ("first", "second")],
        "taken": pidtsm.own_law("pid", "", proportional, (GAIN, DAMPING)),
        "other": CUBIC,
    }

    class Offer(EntryPoint):
        def load(self) -> Any:
            return offers[self.name]

    points = [Offer(name, "theirs:LAW", "pidtsm.laws") for name in offers]
    monkeypatch.setattr(families, "_offers", lambda: EntryPoints(points))
    found: Family[pidtsm.Law] = Family(pidtsm.Law, "laws", COMPUTED_TORQUE, LAWS["pid"])
    with pytest.warns(MemberWarning) as warned:
        assert found.names == ("computed_torque", "pid", "offered", "first", "second")
    reasons = [str(each.message) for each in warned]
    assert len(reasons) == 2
    assert "pidtsm already has a Law of this name" in reasons[0]
    assert "is no Law" in reasons[1]
