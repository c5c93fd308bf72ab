"""Sets that violate a condition are named, sets that do not are not; roots are those of foreign judges."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lti

import pidtsm_core
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.laws import LAWS
from pidtsm_core.laws.reaching import REACHING_LAWS
from pidtsm_core.laws.sliding_mode import MANIFOLDS
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters import names
from pidtsm_core.robots import NAMES
from pidtsm_studies.theory.check import checked
from pidtsm_studies.theory.condition import Condition, Verdict
from pidtsm_studies.theory.conditions import (
    MANIFOLD_RULES,
    REACHING_RULES,
    SURFACE_RULES,
    conditions,
    error_rate,
    manifold_roots,
    violations,
)
from pidtsm_studies.theory.whole_arm import LAW_RULES

ROOT = Path(__file__).resolve().parents[5]
PARAMS = Path(pidtsm_core.__file__).parent / "experiment" / "params"
TUNED = sorted((PARAMS / "tuned").glob("*.yaml"))
TOURNAMENT = sorted(ROOT.glob("docs/tournament/tune/*/*/*/params.yaml"))
TABLE_1 = {"k1": 3.0, "k2": 0.5, "alpha": 7 / 9, "kp": 2.0, "ki": 1.0, "kd": 0.5}

VIOLATING: Mapping[str, tuple[str, Mapping[str, Any], str]] = {
    "Kp and Ki": ("piddtsm", {"law.kp": 0.0, "law.ki": 0.0}, "manifold"),
    "Kp of one joint": ("piddtsm", {"law.kp": [2.0, 0.0]}, "manifold"),
    "Ki": ("pidnftsm", {"law.ki": 0.0}, "manifold"),
    "K1": ("piddtsm", {"law.k1": 0.0}, "terminal gain"),
    "K2": ("dtsm", {"law.k2": [0.0, 0.5]}, "linear gain"),
    "lambda below p/q": ("pidnftsm", {"law.lambda": 1.2}, "order of the exponents"),
    "lambda as p/q": ("pidnftsm", {"law.lambda": 9 / 7}, "order of the exponents"),
    "K1 of the comparator": ("pidnftsm", {"law.k1": 0.0}, "gain of the error's power"),
    "k": ("piddtsm", {"law.k": 0.0}, "pole"),
    "xi": ("piddtsm", {"law.xi": 0.0}, "margin"),
    "upsilon": ("dtsm", {"law.upsilon": 0.0}, "dead zone"),
    "gain of the root": ("super_twisting", {"law.gain": 0.0}, "gain of the root"),
    "switched integral": ("super_twisting", {"law.integral_gain": [0.0, 1.0]}, "gain of the switched integral"),
    "switching gain": ("sliding_mode", {"law.gain": 0.0}, "switching gain"),
    "integral surface": ("sliding_mode", {"law.surface": "integral", "law.k2": 0.0}, "surface"),
    "fast surface": ("sliding_mode", {"law.surface": "fast_terminal", "law.k2": 0.0}, "linear gain"),
    "damping": ("computed_torque", {"law.kd": 0.0}, "loop"),
    "stiffness": ("computed_torque", {"law.kp": 0.0}, "loop"),
    "slope": ("slotine_li", {"law.slope": [5.0, 0.0]}, "slope"),
    "rate": ("slotine_li", {"law.rate": 0.0}, "rate"),
    "switching": ("integral_sliding_mode", {"law.gain": 0.0}, "switching gain"),
    "observed": ("disturbance_observer", {"law.kd": 0.0}, "loop"),
    "ratio": ("time_delay", {"law.p_over_q": 1.0}, "ratio of the exponents"),
    "integral too strong": ("pid", {"law.ki": 9000.0}, "loop"),
    "no damping": ("pid", {"law.kd": 0.0}, "loop"),
}
"""By name: law, parameters that violate a single condition, and its name."""


def found(experiment: Experiment) -> tuple[Condition, ...]:
    return checked(experiment.values["controller"], None).conditions


def violated(conditions: tuple[Condition, ...]) -> list[Condition]:
    return [each for each in conditions if each.verdict is Verdict.VIOLATED]


@pytest.mark.parametrize(("law", "parameters", "name"), VIOLATING.values(), ids=VIOLATING)
def test_a_set_that_violates_one_condition_is_named(law: str, parameters: Mapping[str, Any], name: str) -> None:
    (condition,) = violated(found(make_experiment(None, law, overrides={"controller": parameters})))
    assert condition.name == name
    assert condition.cure.startswith("set law.")
    changed = next(value for value in parameters.values() if not isinstance(value, str))
    wrong = [j for j, value in enumerate(changed) if value == 0.0] if isinstance(changed, list) else [0, 1]
    assert condition.joints == tuple(wrong)


@pytest.mark.parametrize("law", LAWS.names)
def test_the_defaults_of_no_law_violate_anything(law: str) -> None:
    conditions = found(make_experiment(None, law))
    assert conditions
    assert not violated(conditions)


@pytest.mark.parametrize("law", ["piddtsm", "pidnftsm", "dtsm"])
def test_table_1_violates_nothing(law: str) -> None:
    assert not violated(found(make_experiment(None, law, params="article")))


@pytest.mark.parametrize("robot", NAMES)
@pytest.mark.parametrize("law", LAWS.names)
def test_the_rule_violates_nothing(robot: str, law: str) -> None:
    assert not violated(found(make_experiment(None, law, params="practical", robot=robot)))


@pytest.mark.parametrize("file", [*TUNED, *TOURNAMENT], ids=lambda file: "-".join(file.with_suffix("").parts[-4:]))
def test_what_was_tuned_violates_nothing(file: Path) -> None:
    robot = file.stem.rpartition("-")[0] if file in TUNED else file.parts[-4]
    assert not violated(found(make_experiment(None, params=str(file), robot=robot)))


def test_there_are_tuned_sets() -> None:
    assert len(TUNED) == 24
    assert len(TOURNAMENT) == 141


def test_every_part_has_its_conditions() -> None:
    assert set(LAW_RULES) == {law.name for law in LAWS.members if law.of_arm}
    assert set(SURFACE_RULES) == set(SURFACES.names)
    assert set(MANIFOLD_RULES) == set(MANIFOLDS)
    assert set(REACHING_RULES) == set(REACHING_LAWS.names)


def test_what_the_proof_does_not_cover_is_said() -> None:
    def not_covered(law: str, params: str = "article") -> set[str]:
        conditions = found(make_experiment(None, law, params=params))
        return {each.name for each in conditions if each.verdict is Verdict.NOT_COVERED}

    assert not_covered("piddtsm") == {"finite time"}
    assert not_covered("piddtsm", "practical") == {"finite time", "layer", "bound of the adaptive gain"}
    assert not_covered("pidnftsm") == {"finite time", "division by zero at e' = 0"}
    assert not_covered("dtsm") == {"sigma = tau_sw + Lambda"}


def test_violations_are_sentences_for_a_warning() -> None:
    values = make_experiment(None, overrides={"controller": {"law.kp": 0.0, "law.ki": 0.0}}).values["controller"]
    (text,) = violations(values, 2)
    assert text.startswith("law piddtsm: manifold, eq. (10): set law.kp, law.ki")
    assert violations(make_experiment(None).values["controller"], 2) == []


@pytest.mark.parametrize(("kp", "ki", "kd"), [(2.0, 1.0, 0.5), (1.0, 4.0, 0.5), (8.0, 8.0, 0.5), (0.3, 0.2, 2.0)])
def test_roots_are_the_poles_of_a_foreign_judge(kp: float, ki: float, kd: float) -> None:
    poles = sorted(lti([1.0], [kd, kp, ki]).poles, key=lambda pole: (-pole.real, pole.imag))
    assert manifold_roots(kp, ki, kd) == pytest.approx(poles)


def test_the_slow_root_of_table_1_is_the_one_that_was_measured() -> None:
    assert manifold_roots(2.0, 1.0, 0.5)[0] == pytest.approx(-0.586, abs=5e-4)


def on_sigma_zero(surface_velocity: Any, end: float) -> tuple[np.ndarray, np.ndarray]:
    """s and e from 0.4 rad on while sigma = 0 holds exactly, at the end and 2 s before, by a foreign integrator."""

    def rates(_t: float, x: np.ndarray) -> tuple[float, float, float]:
        e, integral, s = x
        return s + surface_velocity(e), s, -(TABLE_1["kp"] * s + TABLE_1["ki"] * integral) / TABLE_1["kd"]

    start = (0.4, 0.0, -surface_velocity(0.4))
    run = solve_ivp(rates, (0.0, end), start, "LSODA", rtol=1e-10, atol=1e-14, t_eval=(end - 2.0, end))
    return run.y[2], run.y[0]


def test_on_sigma_zero_s_decays_at_the_slow_root_and_e_at_nine_sevenths_of_it() -> None:
    def velocity(e: float) -> float:
        size = abs(e)
        return float(-np.sign(e) * (3.0 * (size ** (7 / 9) + size**3) + 0.5 * size))

    s, e = on_sigma_zero(velocity, 20.0)
    slow = -manifold_roots(2.0, 1.0, 0.5)[0].real
    assert np.log(s[0] / s[1]) / 2.0 == pytest.approx(slow, rel=1e-3)
    gains = {name: np.array([value]) for name, value in TABLE_1.items()}
    follows = float(error_rate("dual_terminal", gains, np.array([slow]))[0])
    assert follows == pytest.approx(9 / 7 * slow)
    assert np.log(e[0] / e[1]) / 2.0 == pytest.approx(follows, rel=5e-3)
    assert abs(e[1]) > 1e-9


@pytest.mark.parametrize(("k1", "expected"), [(0.2, 0.2), (10.0, 0.586)])
def test_on_a_linear_surface_the_slower_of_both_counts(k1: float, expected: float) -> None:
    _, e = on_sigma_zero(lambda e: -k1 * e, 40.0)
    assert error_rate("linear", {"k1": np.array([k1])}, np.array([0.586]))[0] == pytest.approx(expected)
    assert np.log(e[0] / e[1]) / 2.0 == pytest.approx(expected, rel=0.01)


def test_the_loop_of_pid_is_stable_up_to_the_gain_of_a_foreign_judge() -> None:
    """Around the integral gain at which the simulated transfer function gets a pole to the right."""
    values = dict(make_experiment(None, "pid").values["controller"])
    joints, inertia = len(names(values["joints"])), np.array([10.0, 5.0])
    cutoff = 200.0

    def poles(ki: float) -> float:
        # J x^2 + Kp + Ki / x + Kd x c / (x + c), times x (x + c)
        return float(
            max(lti([1.0], [10.0, 10.0 * cutoff, 500.0 + 100.0 * cutoff, 500.0 * cutoff + ki, ki * cutoff]).poles.real)
        )

    for ki in (4000.0, 4500.0, 5000.0, 6000.0):
        values["law.ki"] = ki
        (condition,) = conditions(values, joints, inertia)
        assert (0 in condition.joints) == (poles(ki) > 0.0)
    assert poles(4000.0) < 0.0 < poles(6000.0)
