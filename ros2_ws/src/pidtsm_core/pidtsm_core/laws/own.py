"""A law of a formula of one's own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import callable_inside
from pidtsm_core.laws.base import Integers, Kernel, Law
from pidtsm_core.laws.baseline import LawOfMember
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Parameter
from pidtsm_core.parameters.family import Member

Formula = Callable[[float, float, float, float, Array, Array, float], float]
Memory = Callable[[float, Array, Array, float], None]


def own_law(
    name: str,
    summary: str,
    formula: Formula,
    parameters: Sequence[Parameter] = (),
    memory: Memory | None = None,
    uses_model: bool = True,
) -> Law:
    """A law whose command is a function, for `register`; the functions are compiled, and need no decorator.

    Args:
        name: the name by which users choose it.
        summary: one sentence with its source.
        formula: ``(e, de, dde, ddq_d, p, x, dt) -> acceleration`` of one joint, called once a sample: errors in rad,
            rad/s, rad/s^2; q_d'' in rad/s^2; p has the parameters in their order; x is the law's memory, which starts
            at zero, shape (STATE_SLOTS,); dt is the time since the last sample, s (0 at the first one). The result is
            in rad/s^2; the robot model turns it into efforts.
        parameters: at most `SLOTS`; one with `per_joint` may differ from joint to joint.
        memory: ``(e, p, x, dt)``, advances x by dt (s), as an integral does. It is not called while nothing may wind
            up, see ``law.anti_windup``.
        uses_model: False if `formula` returns an effort, N m; then the robot model is not used.
    """
    own = _OwnLaw(Member(name, summary, tuple(parameters)), formula, memory)
    return Law(name, summary, own.parameters, own.integers, own.pack, own.kernel, uses_model)


@dataclass(frozen=True)
class _OwnLaw(LawOfMember):
    """A law of a formula; an object, not closures, so that processes can exchange it."""

    formula: Formula
    memory: Memory | None

    def kernel(self, _integers: Integers) -> Kernel:
        return _kernel(self.formula, self.memory or _forget)


@cache
def _kernel(formula: Formula, memory: Memory) -> Kernel:
    compute, remember = callable_inside(formula), callable_inside(memory)

    def command(
        e: float, de: float, dde: float, ddq_d: float, _integers: Integers, p: Array, x: Array, dt: float
    ) -> tuple[float, float, float, float, float, float]:
        """See `Kernel.command`."""
        result = compute(e, de, dde, ddq_d, p, x, dt)
        return result, result, 0.0, 0.0, 0.0, 0.0

    def advance(
        e: float, _s: float, _sigma: float, _integers: Integers, p: Array, x: Array, interval: Interval
    ) -> None:
        """See `Kernel.advance`."""
        if not interval.frozen:
            remember(e, p, x, interval.dt)

    return Kernel(command, advance)


def _forget(_e: float, _p: Array, _x: Array, _dt: float) -> None:
    """Of a law without memory."""
