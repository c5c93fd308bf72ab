"""The rule for the gains of each law, given the bandwidth of its observer: `gains_of_law`."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import Value

_MANIFOLD = 8.0 / 60.0
"""Kp and Ki of a PID manifold, relative to the bandwidth of the observer."""
_DERIVATIVE = 0.5
"""Kd of a PID manifold."""
_LEAST_ZONE = 0.05
"""Smallest dead zone of the adaptation, for ideal sensors."""
_MODEL_BASED = 0.25
"""Bandwidth of a law with a linear surface, or of computed torque, relative to that of the observer."""
_WITH_INTEGRAL = 0.15
"""Three poles of a law with a model and an integral, relative to the bandwidth of the observer."""
_MODEL_FREE = 0.55
"""Bandwidth of PID, relative to that of the observer: nothing else resists friction and gravity. With our arms,
friction leaves 10 mrad at a third of the observer's bandwidth, and the torque is twice as rough at two thirds."""
_CONSTANT = 0.5
"""Constant inertia of a law without a model, relative to that of the model in the middle of the range."""


@dataclass(frozen=True)
class Gain:
    """One parameter of the controller.

    Attributes:
        name: its full name.
        value: one number per joint, or one for all.
        reason: why it has this value, one sentence.
    """

    name: str
    value: Value
    reason: str


@dataclass(frozen=True)
class Known:
    """What the rules know of an arm, shape (joints,) each.

    Attributes:
        bandwidth: of the observer, rad/s.
        steps: of the encoders, rad or m; 0: ideal.
        inertia: diagonal of the inertia matrix in the middle of the range, kg m^2 or kg.
    """

    bandwidth: Array
    steps: Array
    inertia: Array


def gains_of_law(law: str, known: Known) -> tuple[Gain, ...]:
    """Parameters of a law, without its name and its observer.

    Args:
        law: its name.
        known: what the rules know of the arm.

    Raises:
        UsageError: there is no rule for the law.
    """
    if law not in _RULES:
        raise UsageError(f"there is no rule for the gains of {law}, only for {', '.join(_RULES)}; set its parameters")
    return _RULES[law](known)


def rejects(law: str) -> bool:
    """Whether the rule for a law subtracts the disturbance that the observer finds.

    Raises:
        UsageError: there is no rule for the law.
    """
    one = np.ones(1)
    return _REJECTION in gains_of_law(law, Known(one, one, one))


def rounded(values: Array) -> tuple[float, ...]:
    """Values of any shape with two significant digits, which is all that such a rule can promise."""
    return tuple(float(f"{value:.2g}") for value in values)


_REJECTION = Gain("law.disturbance_rejection", True, "unknown torques accelerate light joints strongly")


def _adaptation(known: Known) -> tuple[Gain, ...]:
    # The estimated acceleration has noise of 0.43 w^2 times that of the position, see `extended_state`.
    noise = _DERIVATIVE * 0.43 * known.bandwidth**2 * known.steps / math.sqrt(12.0)
    return (
        Gain(
            "law.upsilon",
            rounded(np.maximum(3.0 * noise, _LEAST_ZONE)),
            "dead zone of the adaptation: three times the noise of sigma, which otherwise makes the gain grow",
        ),
        Gain("law.xi", 0.3, "the least switching gain, so that little is left to adapt to"),
        Gain("law.layer", 0.02, "the sign of sigma would make a large gain chatter"),
        Gain("law.gain_maximum", 20.0, "the observer leaves little to adapt to, so more would be noise"),
    )


def _pid_manifold(known: Known) -> tuple[Gain, ...]:
    gain = rounded(_MANIFOLD * known.bandwidth)
    return (
        _REJECTION,
        Gain("law.kp", gain, f"{_MANIFOLD:.2f} times the bandwidth: the law must be slower than the observer"),
        Gain("law.ki", gain, "the same"),
        Gain("law.kd", _DERIVATIVE, "as in the article's Table 1"),
        *_adaptation(known),
    )


def _dual_terminal(known: Known) -> tuple[Gain, ...]:
    pole = rounded(_MODEL_BASED * known.bandwidth)
    return (
        _REJECTION,
        Gain("law.k1", 6.0, "twice the article's: the surface has no PID to help it"),
        Gain("law.k2", 4.0, "the error decays at this rate where the terminal term is small"),
        Gain("law.k", pole, f"{_MODEL_BASED:g} times the bandwidth: the law must be slower than the observer"),
        *_adaptation(known),
    )


def _linear_surface(known: Known) -> Gain:
    rate = rounded(_MODEL_BASED * known.bandwidth)
    return Gain("law.k1", rate, f"{_MODEL_BASED:g} times the bandwidth: the law must be slower than the observer")


def _sliding_mode(known: Known) -> tuple[Gain, ...]:
    return (
        _REJECTION,
        Gain("law.surface", "linear", "the simplest one"),
        _linear_surface(known),
        Gain("law.reaching", "boundary_layer", "the sign of sigma would chatter"),
        Gain("law.gain", 1.0, "the observer leaves little to switch against"),
        Gain("law.width", rounded(1.0 / (_MODEL_BASED * known.bandwidth)), "sigma decays as fast as the error"),
    )


def _super_twisting(known: Known) -> tuple[Gain, ...]:
    return (
        _REJECTION,
        _linear_surface(known),
        Gain("law.gain", 1.0, "the observer leaves little to switch against"),
        Gain("law.integral_gain", 0.1, "small: the observer finds constant disturbances"),
    )


def _computed_torque(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_BASED * known.bandwidth
    return (
        _REJECTION,
        Gain("law.kp", rounded(rate**2), f"a double pole at {_MODEL_BASED:g} times the bandwidth of the observer"),
        Gain("law.kd", rounded(2.0 * rate), "the same"),
    )


def _pid(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_FREE * known.bandwidth
    reason = f"a triple pole at {_MODEL_FREE:g} times the bandwidth of the observer, with the joint's inertia"
    return (
        Gain("law.kp", rounded(3.0 * known.inertia * rate**2), reason),
        Gain("law.ki", rounded(known.inertia * rate**3), "the same"),
        Gain("law.kd", rounded(3.0 * known.inertia * rate), "the same"),
    )


def _slotine_li(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_BASED * known.bandwidth
    reason = f"{_MODEL_BASED:g} times the bandwidth: the law must be slower than the observer"
    return (
        Gain("law.slope", rounded(rate), reason),
        Gain("law.rate", rounded(rate), reason),
        Gain("law.adaptation", rounded((3.0 * rate) ** 2), "faster than s, because several moments share an error"),
    )


def _integral_sliding_mode(known: Known) -> tuple[Gain, ...]:
    return (
        *_computed_torque(known),
        Gain("law.gain", 1.0, "the observer leaves little to switch against"),
        Gain("law.width", rounded(1.0 / (_MODEL_BASED * known.bandwidth)), "s decays as fast as the error"),
    )


def _linear_quadratic(known: Known) -> tuple[Gain, ...]:
    slowest = float(known.bandwidth.min())
    reason = f"{_WITH_INTEGRAL:g} times the least bandwidth of the observer: one number for the whole arm"
    return (Gain("law.bandwidth", rounded(np.array([_WITH_INTEGRAL * slowest]))[0], reason),)


def _predictive(known: Known) -> tuple[Gain, ...]:
    rate = rounded(_MODEL_BASED * known.bandwidth)
    return (
        _REJECTION,
        Gain("law.bandwidth", rate, f"{_MODEL_BASED:g} times the bandwidth: the law must be slower than the observer"),
    )


def _time_delay(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_FREE * known.bandwidth
    return (
        _constant_inertia(known),
        Gain("law.beta", rounded(rate), f"{_MODEL_FREE:g} times the bandwidth of the observer"),
        Gain("law.k1", rounded(rate**2), "s decays as fast as the error"),
        Gain("law.k2", 1.0, "the filter of N leaves little to switch against"),
        Gain("law.cutoff", rounded(3.0 * known.bandwidth), "three times the bandwidth: the observer filters already"),
    )


def _disturbance_observer(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_FREE * known.bandwidth
    reason = f"a double pole at {_MODEL_FREE:g} times the bandwidth of the observer"
    return (
        _constant_inertia(known),
        Gain("law.kp", rounded(rate**2), reason),
        Gain("law.kd", rounded(2.0 * rate), "the same"),
        Gain("law.cutoff", rounded(known.bandwidth), "the bandwidth of the observer"),
    )


def _impedance(known: Known) -> tuple[Gain, ...]:
    rate = _MODEL_BASED * float(known.bandwidth.min())
    stiff = rounded(rate**2 * np.array([known.inertia.max(), known.inertia.min()]))
    reason = f"{_MODEL_BASED:g} times the least bandwidth of the observer, with the largest inertia of a joint at 1 m"
    return (
        *(Gain(f"law.stiffness_{axis}", stiff[0], reason) for axis in "xyz"),
        Gain("law.rotational_stiffness", stiff[1], "the same, with the smallest inertia of a joint"),
        Gain("law.null_space", rounded(np.array([rate]))[0], "as fast as the tool"),
    )


def _constant_inertia(known: Known) -> Gain:
    reason = f"{_CONSTANT:g} times that in the middle of the range: too much of it is unstable"
    return Gain("law.inertia", rounded(_CONSTANT * known.inertia), reason)


_RULES: Mapping[str, Callable[[Known], tuple[Gain, ...]]] = {
    "piddtsm": _pid_manifold,
    "pidnftsm": _pid_manifold,
    "dtsm": _dual_terminal,
    "sliding_mode": _sliding_mode,
    "super_twisting": _super_twisting,
    "computed_torque": _computed_torque,
    "pid": _pid,
    "slotine_li": _slotine_li,
    "time_delay": _time_delay,
    "integral_sliding_mode": _integral_sliding_mode,
    "disturbance_observer": _disturbance_observer,
    "linear_quadratic": _linear_quadratic,
    "predictive": _predictive,
    "impedance": _impedance,
}
RULED = tuple(_RULES)
"""Names of the laws that have a rule."""
