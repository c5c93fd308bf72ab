"""Properties of every control law, and of the combinations of surfaces, manifolds and reaching laws.

A law is that of a joint. It is tested for the last joint of each arm, whose gains are packed with those of the others.
"""

import math
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.pairs import paired
from support.testarms import ARMS, Arm

from pidtsm_core.compiling.decorators import njit
from pidtsm_core.control import controller_schema
from pidtsm_core.laws import LAWS, STATE_SLOTS, Interval, LawConfig, advance, command, make_law
from pidtsm_core.laws.reaching import REACHING_LAWS
from pidtsm_core.laws.sliding_mode import ACCELERATION_BOUND, MANIFOLDS
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.signals import Adaptation

PROPERTY = settings(deadline=None, max_examples=12)
COMPOSED = [
    {"law.name": "sliding_mode", "law.surface": surface, "law.manifold": manifold, "law.reaching": reaching}
    for surface, manifold, reaching in product(SURFACES.names, MANIFOLDS, REACHING_LAWS.names)
    # Every surface with one reaching law and every reaching law with one surface, both with every manifold.
    if surface == SURFACES.names[0] or reaching == REACHING_LAWS.names[0]
]
NAMED = [{"law.name": law.name} for law in LAWS.members if law.name != "sliding_mode" and not law.of_arm]
SLIDING = [c for c in NAMED + COMPOSED if c["law.name"] not in ("computed_torque", "pid")]
# Every law and every arm: the arm decides where the gains of its last joint are, and the law what becomes of them.
EACH, EACH_SLIDING = paired("chosen,arm", NAMED + COMPOSED, ARMS), paired("chosen,arm", SLIDING, ARMS)
SPECIAL = [0.0, -0.0, 5e-324, -1e-200, 1e-12, -1.0, 1e6]


EVALUATE = [njit(surface.evaluate) for surface in SURFACES.members]


@cache
def made(arm: Arm, chosen: tuple[tuple[str, Value], ...]) -> tuple[dict[str, Value], LawConfig]:
    """Parameters of an arm whose last joint has the chosen gains, and its law, in which the others have other ones."""
    settings = dict(chosen)
    schema = {p.name: p for p in controller_schema({**arm.settings, **settings})}
    values = arm.values(controller_schema, {name: value for name, value in settings.items() if name in schema})
    law, each = LAWS[str(values["law.name"])], dict(values)
    for name, value in values.items():
        if name.startswith("law.") and schema[name].per_joint:
            each[name] = arm.last(as_float(value))
    return values, make_law(law, each, arm.joints)


class OneJoint:
    """The law of the last joint of an arm, with its default gains or the given ones."""

    def __init__(self, arm: Arm, chosen: dict[str, str], **gains: Value) -> None:
        every: dict[str, Value] = {**chosen, **{f"law.{name}": gain for name, gain in gains.items()}}
        self.values, self.law = made(arm, tuple(every.items()))
        self.joint, self.integers = arm.joints - 1, self.law.integers
        self.p, self.x = self.law.gains[-1], np.zeros(STATE_SLOTS)

    def command(self, e: float, de: float, dde: float, ddq_d: float) -> tuple[float, ...]:
        return command(self.law, self.joint, e, de, dde, ddq_d, self.x, 0.001)

    def advance(self, e: float, s: float, sigma: float, dt: float, frozen: bool) -> None:
        advance(self.law, self.joint, e, s, sigma, self.x, Interval(dt, frozen, Adaptation.NORMAL.value))


@EACH_SLIDING
@PROPERTY
@given(
    e=st.floats(-1.0, 1.0),
    de=st.floats(-3.0, 3.0),
    dde=st.floats(-20.0, 20.0),
    ddq_d=st.floats(-1.0, 1.0),
    state=st.lists(st.floats(0.0, 2.0), min_size=STATE_SLOTS, max_size=STATE_SLOTS),
)
def test_sigma_is_the_switching_term_when_the_commanded_acceleration_comes_true(
    arm: Arm, chosen: dict[str, str], e: float, de: float, dde: float, ddq_d: float, state: list[float]
) -> None:
    """Eq. (32) without disturbance; with sigma = s, the switching term equals s' instead."""
    joint = OneJoint(arm, chosen, kp=2.0, ki=1.0, kd=0.5)
    joint.x[:] = state
    _, g, h = EVALUATE[joint.integers[0]](e, de, joint.x[1], joint.p[:SLOTS])
    assume(g > 1e-2)
    a_cmd, a_eq, s, _, _, tau_sw = joint.command(e, de, dde, ddq_d)
    realised = a_cmd - ddq_d
    size = (abs(a_cmd) + abs(ddq_d)) * g + abs(h) + abs(tau_sw) + 1.0
    if MANIFOLDS[joint.integers[1]] == "none":
        assert g * realised + h == pytest.approx(tau_sw, rel=0, abs=1e-9 * size)
        assert a_cmd - a_eq == pytest.approx(tau_sw / g, rel=0, abs=1e-9 * size / g)
    else:
        _, _, _, sigma, _, _ = joint.command(e, de, realised, ddq_d)
        size += 2.0 * abs(s) + abs(joint.x[0])
        assert sigma == pytest.approx(tau_sw, rel=0, abs=1e-9 * size)
        assert a_cmd - a_eq == pytest.approx(tau_sw / (0.5 * g), rel=0, abs=1e-9 * size / g)


@EACH_SLIDING
@PROPERTY
@given(e=st.floats(-1.0, 1.0), de=st.floats(-3.0, 3.0), dde=st.floats(-20.0, 20.0), integral=st.floats(-5.0, 5.0))
def test_sigma_follows_eq_10(
    arm: Arm, chosen: dict[str, str], e: float, de: float, dde: float, integral: float
) -> None:
    joint = OneJoint(arm, chosen, kp=3.0, ki=0.7, kd=0.25)
    joint.x[0] = integral
    expected_s, g, h = EVALUATE[joint.integers[0]](e, de, 0.0, joint.p[:SLOTS])
    _, _, s, sigma, _, _ = joint.command(e, de, dde, 0.0)
    assert s == expected_s
    if MANIFOLDS[joint.integers[1]] == "none":
        assert sigma == s
    else:
        rate = g * dde + h
        size = abs(s) + abs(integral) + abs(g * dde) + abs(h)
        assert sigma == pytest.approx(3.0 * s + 0.7 * integral + 0.25 * rate, rel=0, abs=1e-12 * size)


@pytest.mark.parametrize("name", [c["law.name"] for c in NAMED if c in SLIDING])
def test_a_named_law_is_bit_for_bit_the_one_composed_of_its_parts(arm: Arm, name: str) -> None:
    named = OneJoint(arm, {"law.name": name})
    surface, manifold, reaching = (int(n) for n in named.integers[:3])
    parts = {
        "law.name": "sliding_mode",
        "law.surface": SURFACES.names[surface],
        "law.manifold": MANIFOLDS[manifold],
        "law.reaching": REACHING_LAWS.names[reaching],
    }
    gains = {n.removeprefix("law."): v for n, v in named.values.items() if n.startswith("law.") and n != "law.name"}
    composed = OneJoint(arm, parts, **gains)
    np.testing.assert_array_equal(composed.integers, named.integers)
    random = np.random.default_rng(5)
    for _ in range(200):
        e, de, dde, ddq_d = random.normal(size=4)
        got, expected = composed.command(e, de, dde, ddq_d), named.command(e, de, dde, ddq_d)
        assert got == expected
        frozen = bool(random.integers(2))
        for joint in (named, composed):
            joint.advance(e, expected[2], expected[3], 0.001, frozen)
        assert named.x.tobytes() == composed.x.tobytes()


def test_piddtsm_is_made_of_the_articles_parts_and_table_1(arm: Arm) -> None:
    joint = OneJoint(arm, {"law.name": "piddtsm"})
    surface, manifold, reaching = (int(n) for n in joint.integers[:3])
    assert SURFACES.names[surface] == "dual_terminal"
    assert MANIFOLDS[manifold] == "pid"
    assert REACHING_LAWS.names[reaching] == "adaptive_continuous"
    table = {"k1": 3.0, "k2": 0.5, "alpha": 7 / 9, "kp": 2.0, "ki": 1.0, "kd": 0.5, "k": 1.0, "kappa": 0.01}
    assert {name: joint.values[f"law.{name}"] for name in table} == table


def test_piddtsm_by_hand(arm: Arm) -> None:
    """a_cmd of CONTROL: q_d'' - K1 (alpha u_f + 3 e^2 e') - K2 e' - (Kp s + Ki int s - tau_sw) / Kd."""
    joint = OneJoint(arm, {"law.name": "piddtsm"}, alpha=0.5)
    joint.x[0], joint.x[3] = 0.3, -0.2
    # e = 0.25, e' = 2: s = 3.671875, s' without e'' = 8.125.
    a_cmd, a_eq, s, sigma, gain, tau_sw = joint.command(0.25, 2.0, -1.0, 0.6)
    assert s == pytest.approx(3.671875)
    assert sigma == pytest.approx(2 * 3.671875 + 0.3 + 0.5 * (-1.0 + 8.125))
    assert a_eq == pytest.approx(0.6 - 8.125 - (2 * 3.671875 + 0.3) / 0.5)
    assert a_cmd == pytest.approx(a_eq - 0.2 / 0.5)
    assert (gain, tau_sw) == (0.0, -0.2)


@EACH
@PROPERTY
@given(
    e=st.sampled_from(SPECIAL) | st.floats(-1e6, 1e6),
    de=st.sampled_from(SPECIAL) | st.floats(-1e6, 1e6),
    dde=st.sampled_from(SPECIAL) | st.floats(-1e6, 1e6),
)
def test_commands_are_finite_and_bounded_everywhere(
    arm: Arm, chosen: dict[str, str], e: float, de: float, dde: float
) -> None:
    joint = OneJoint(arm, chosen)
    for _ in range(3):
        a_cmd, a_eq, s, sigma, gain, tau_sw = joint.command(e, de, dde, 0.5)
        assert all(math.isfinite(v) for v in (a_cmd, a_eq, s, sigma, gain, tau_sw))
        assert max(abs(a_cmd), abs(a_eq)) <= ACCELERATION_BOUND
        joint.advance(e, s, sigma, 0.001, False)
        assert np.isfinite(joint.x).all()


@EACH
def test_without_error_the_reference_is_followed(arm: Arm, chosen: dict[str, str]) -> None:
    a_cmd, a_eq, _, sigma, _, tau_sw = OneJoint(arm, chosen).command(0.0, 0.0, 0.0, 0.7)
    assert sigma == 0.0
    assert tau_sw == 0.0
    # With a surface that is singular there (g = 0), any finite command is permitted.
    assert a_cmd == a_eq


@EACH
@PROPERTY
@given(e=st.floats(-1.0, 1.0), de=st.floats(-3.0, 3.0), dde=st.floats(-20.0, 20.0))
def test_opposite_errors_give_opposite_commands(
    arm: Arm, chosen: dict[str, str], e: float, de: float, dde: float
) -> None:
    here, there = OneJoint(arm, chosen), OneJoint(arm, chosen)
    for _ in range(3):
        a_cmd, a_eq, s, sigma, gain, tau_sw = here.command(e, de, dde, 0.0)
        assert there.command(-e, -de, -dde, 0.0) == (-a_cmd, -a_eq, -s, -sigma, gain, -tau_sw)
        here.advance(e, s, sigma, 0.001, False)
        there.advance(-e, -s, -sigma, 0.001, False)


@EACH_SLIDING
def test_a_frozen_law_does_not_integrate(arm: Arm, chosen: dict[str, str]) -> None:
    joint = OneJoint(arm, chosen)
    joint.advance(0.5, 2.0, 3.0, 0.01, False)
    assert joint.x[:2].tolist() == pytest.approx([0.02, 0.005])
    kept = joint.x[:2].copy()
    gain = joint.command(0.5, 0.1, 0.0, 0.0)[4]
    joint.advance(0.5, 2.0, 3.0, 0.01, True)
    assert joint.x[:2].tolist() == kept.tolist()
    assert joint.command(0.5, 0.1, 0.0, 0.0)[4] == gain
