"""Sliding-mode laws as surface x manifold x reaching law.

With s' = g e'' + h (see `surfaces`) and tau_sw from the reaching law, the commanded acceleration is

    manifold none:   sigma = s                             a_cmd = q_d'' + (-h + tau_sw) / g
    manifold pid:    sigma = Kp s + Ki int s + Kd s'       a_cmd = q_d'' + (-h - (Kp s + Ki int s - tau_sw) / Kd) / g

Most reaching laws prescribe the rate of sigma. With manifold none, sigma' = tau_sw, so tau_sw is that rate. With
manifold pid, sigma = tau_sw (eq. (32)), so tau_sw is the integral of that rate.

The formulas are eqs. (10), (15), (16), (20), (21) of the article solved for q''.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import callable_inside, inlined
from pidtsm_core.laws.base import Integers, Kernel, Law, LawParts
from pidtsm_core.laws.reaching import REACHING_LAWS, Interval, ReachingLaw
from pidtsm_core.laws.surfaces import SURFACES, Surface
from pidtsm_core.parameters import Parameter, Value, chosen, joint_array, prefixed
from pidtsm_core.parameters.family import SLOTS

MANIFOLDS = ("none", "pid")
_PID = MANIFOLDS.index("pid")

# Columns of the packed parameters: surface, then manifold, then reaching law.
_MANIFOLD = SLOTS
_REACHING = SLOTS + 3
# State x: int s, int e, integral of a prescribed rate of sigma, then the state of the reaching law.
_REACHING_STATE = 3

ACCELERATION_BOUND = 1e9
"""rad/s^2; keeps the command of a singular law (1/g unbounded) finite; far above what any torque limit allows."""

# Defaults from the article's Table 1.
_MANIFOLD_PARAMETERS = (
    Parameter("kp", 2.0, "gain Kp of s in sigma, eq. (10)", "1/s", minimum=0.0, per_joint=True),
    Parameter("ki", 1.0, "gain Ki of the integral of s in sigma, eq. (10)", "1/s^2", minimum=0.0, per_joint=True),
    Parameter("kd", 0.5, "gain Kd of s' in sigma, eq. (10)", minimum=0.0, exclusive=True, per_joint=True),
)
ANTI_WINDUP = Parameter(
    "anti_windup",
    "conditional",
    "conditional: the integrals and the adaptation of a joint pause while its torque, or the rate of its torque, is at "
    "a limit, or the drives report another torque, and in contact (limits.external_effort); none: as in the article",
    choices=("conditional", "none"),
)
# Defaults: sliding mode as textbooks have it (Slotine and Li 1991, section 7.2).
_SURFACE = Parameter("surface", "linear", "sliding surface", choices=SURFACES, read_only=True)
_MANIFOLD_CHOICE = Parameter("manifold", "none", "sigma = s, or PID of s, eq. (10)", choices=MANIFOLDS, read_only=True)
_REACHING_CHOICE = Parameter("reaching", "boundary_layer", "reaching law", choices=REACHING_LAWS, read_only=True)
_CHOICES = (_SURFACE, _MANIFOLD_CHOICE, _REACHING_CHOICE)

_UNITS_WITHOUT_MANIFOLD = {"kappa": "s^3"}
"""tau_sw is then the rate of sigma, so the rate of the adaptive gain has another 1/s."""


@inlined
def _finite(acceleration: float) -> float:
    """Limit the acceleration to its bound; nan (0 times infinity at a singularity) becomes 0."""
    if math.isnan(acceleration):
        return 0.0
    return min(max(acceleration, -ACCELERATION_BOUND), ACCELERATION_BOUND)


@cache
def _kernel(surface: Surface, reaching: ReachingLaw) -> Kernel:
    """Functions of the laws with these parts, see `Law`: what is known when a law is chosen is compiled into them."""
    evaluate, switch = callable_inside(surface.evaluate), callable_inside(reaching.switch)
    advance_reaching = callable_inside(reaching.advance)

    def command(
        e: float, de: float, dde: float, ddq_d: float, integers: Integers, p: Array, x: Array, dt: float
    ) -> tuple[float, float, float, float, float, float]:
        """See `Kernel.command`."""
        s, g, h = evaluate(e, de, x[1], p[:SLOTS])
        if integers[1] == _PID:
            kp, ki, kd = p[_MANIFOLD], p[_MANIFOLD + 1], p[_MANIFOLD + 2]
            proportional_integral = kp * s + ki * x[0]
            sigma = proportional_integral + kd * (g * dde + h)
            tau_sw, gain = switch(sigma, p[_REACHING:], x[_REACHING_STATE:], dt)
            if integers[3]:
                tau_sw = x[2]
            a_eq = ddq_d + (-h - proportional_integral / kd) / g
            a_cmd = ddq_d + (-h - (proportional_integral - tau_sw) / kd) / g
        else:
            sigma = s
            tau_sw, gain = switch(sigma, p[_REACHING:], x[_REACHING_STATE:], dt)
            a_eq = ddq_d - h / g
            a_cmd = ddq_d + (-h + tau_sw) / g
        return _finite(a_cmd), _finite(a_eq), s, sigma, gain, tau_sw

    def advance(e: float, s: float, sigma: float, integers: Integers, p: Array, x: Array, interval: Interval) -> None:
        """See `Kernel.advance`; explicit Euler."""
        dt = interval.dt
        if not interval.frozen:
            x[0] += dt * s
            x[1] += dt * e
            if integers[3]:
                x[2] += dt * switch(sigma, p[_REACHING:], x[_REACHING_STATE:], dt)[0]
        advance_reaching(sigma, p[_REACHING:], x[_REACHING_STATE:], interval)

    return Kernel(command, advance)


def _parameters(parts: LawParts, defaults: Mapping[str, Value]) -> Iterator[Parameter]:
    """Parameters of the parts, with the given defaults."""
    members = SURFACES[parts.surface].parameters
    members += _MANIFOLD_PARAMETERS if parts.manifold == "pid" else ()
    members += REACHING_LAWS[parts.reaching].parameters
    for p in members:
        unit = p.unit if parts.manifold == "pid" else _UNITS_WITHOUT_MANIFOLD.get(p.name, p.unit)
        yield replace(p, default=defaults.get(p.name, p.default), unit=unit)


def _integers(parts: LawParts) -> Integers:
    """Indices of surface, manifold and reaching law, and whether a prescribed rate of sigma is integrated."""
    return np.array(
        [
            SURFACES.index(parts.surface),
            MANIFOLDS.index(parts.manifold),
            REACHING_LAWS.index(parts.reaching),
            parts.manifold == "pid" and REACHING_LAWS[parts.reaching].prescribes_rate,
        ],
        dtype=np.int64,
    )


def _pack(parts: LawParts, values: Mapping[str, Value], joints: int) -> Array:
    """See `Law.pack`."""
    packed = np.zeros((joints, _REACHING + SLOTS))
    packed[:, :SLOTS] = SURFACES[parts.surface].pack(values, "law", joints)
    if parts.manifold == "pid":
        for column, parameter in enumerate(_MANIFOLD_PARAMETERS, start=_MANIFOLD):
            packed[:, column] = joint_array(values[f"law.{parameter.name}"], joints)
    packed[:, _REACHING:] = REACHING_LAWS[parts.reaching].pack(values, "law", joints)
    return packed


@dataclass(frozen=True)
class _Composition:
    """A law's parts, and its functions, see `Law`; an object, not closures, so that processes can exchange laws."""

    fixed: tuple[str | None, str | None, str | None]  # None: a parameter of the law chooses the part
    defaults: Mapping[str, Value]

    def parts(self, settings: Mapping[str, object]) -> LawParts:
        named = zip(prefixed("law", _CHOICES), self.fixed, strict=True)
        return LawParts(*(part or chosen(settings, choice) for choice, part in named))

    def parameters(self, settings: Mapping[str, object]) -> tuple[Parameter, ...]:
        left_out = (choice for choice, part in zip(_CHOICES, self.fixed, strict=True) if part is None)
        return (*left_out, *_parameters(self.parts(settings), self.defaults), ANTI_WINDUP)

    def integers(self, values: Mapping[str, Value]) -> Integers:
        return _integers(self.parts(values))

    def pack(self, values: Mapping[str, Value], joints: int) -> Array:
        return _pack(self.parts(values), values, joints)

    def kernel(self, integers: Integers) -> Kernel:
        return _kernel(SURFACES.members[integers[0]], REACHING_LAWS.members[integers[2]])


def compose(
    name: str,
    summary: str,
    surface: str | None = None,
    manifold: str | None = None,
    reaching: str | None = None,
    defaults: Mapping[str, Value] | None = None,
) -> Law:
    """Compose a law from named parts; a part that is left out becomes a parameter of the law.

    Args:
        name: the name by which users choose the law.
        summary: one sentence with its source.
        surface: name in `SURFACES`.
        manifold: name in `MANIFOLDS`.
        reaching: name in `REACHING_LAWS`.
        defaults: values that differ from the parts' own defaults.
    """
    made = _Composition((surface, manifold, reaching), defaults or {})
    return Law(name, summary, made.parameters, made.integers, made.pack, made.kernel, parts=made.parts)


SLIDING_MODE = compose("sliding_mode", "any surface, manifold and reaching law, chosen by parameter")
