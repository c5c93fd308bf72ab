"""The gains of `first_gains` for the hardware that a simulated arm has, not for one that is assumed."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import LAW_NAME
from pidtsm_core.control.joint_friction import REVERSAL
from pidtsm_core.experiment.gains import first_gains, rotors
from pidtsm_core.experiment.law_gains import Gain, rejects, rounded
from pidtsm_core.experiment.loop_margin import Drives
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Value, as_float, joint_array
from pidtsm_core.robots import find_robot
from pidtsm_core.simulation.drivetrain import ENCODER, MOTOR, STIFFNESS
from pidtsm_core.simulation.simulator import simulator_schema

_USED = (
    "rate",
    "encoder.bits",
    "delay.samples",
    "delay.command_samples",
    "actuator.lag",
    "actuator.frequency",
    "actuator.damping",
    "elasticity.damping",
    "friction.coulomb",
    "friction.cold",
    STIFFNESS.name,
    ENCODER.name,
)
_SLOWEST_RATE = 10.0
"""1/s; see `_lets_observe`."""
_STATIC = 1.3
"""Friction of joints that stick, relative to the Coulomb friction. More is not: the error corrects it."""
_STICKS = 0.03
"""Share of the effort limit from which on friction makes a joint stick; less is found by the observer soon enough."""
_PRESSES, _STEP_PRESSES = 8.0, 0.3
"""Largest `compensation.error_gain`, 1/s, and the share of a step of REVERSAL that one step of the encoder may be."""
PRESSES = "presses joints that stick; with a coarse encoder, less than its steps make rough"
"""Why `compensation.error_gain` is what `error_gain` says."""
_LONGEST = 20
"""Samples; behind a longer delay the bandwidth is so low that no joint resonates."""


def hardware_gains(
    controller: Mapping[str, object],
    simulator: Mapping[str, object],
    law: str = str(LAW_NAME.default),
    knows_springs: bool = True,
    learns_friction: bool = False,
) -> tuple[Gain, ...]:
    """Gains of a law for an arm and for the sensors, drives and gears that its simulator has.

    Rate, resolution, delay, lag and elasticity bound the bandwidth, and the Coulomb friction of half-warm gears is
    compensated. The observer of a law that rejects disturbances knows elastic gears. Joints that stick are pressed by
    their error, unless the rate of the effort is limited: it could not follow. What else the friction does (load,
    temperature, the difference of the directions) is unknown to the controller.

    Args:
        controller: parameters that differ from their defaults; those of robot and payload matter.
        simulator: likewise.
        law: its name.
        knows_springs: without, the observer takes elastic joints for rigid ones.
        learns_friction: the gains shall also suit ``adaptation.friction: learn``.

    Raises:
        UsageError: see `first_gains`; also (`ParameterError`) a refused parameter of the simulator.
    """
    robot = find_robot(simulator)
    joints = len(robot.joints)
    schema = {p.name: p for p in simulator_schema(simulator)}
    used = {name: schema[name].check(simulator.get(name, schema[name].default), joints) for name in _USED}
    rate, delay = as_float(used["rate"]), int(as_float(used["delay.samples"]) + as_float(used["delay.command_samples"]))
    rotor, on_motor = rotors(controller), used[ENCODER.name] == MOTOR
    stiffness = np.where(rotor > 0.0, joint_array(used[STIFFNESS.name], joints), 0.0)
    lag = float((joint_array(used["actuator.lag"], joints) + _current_lag(used, joints)).max())
    observed = knows_springs and rejects(law) and bool(stiffness.any()) and _lets_observe(controller, on_motor)
    damping = joint_array(used["elasticity.damping"], joints)
    drives = make_drives(rate, delay, lag, Drivetrain(rotor, stiffness, damping, on_motor), observed)
    drives = replace(drives, corrected=learns_friction)
    bits = int(as_float(used["encoder.bits"]))
    gains = first_gains(controller, bits, delay / rate + drives.lag, rate, law, drives)
    friction = joint_array(used["friction.coulomb"], joints) * (1.0 + 0.5 * as_float(used["friction.cold"]))
    if not LAWS[law].uses_model or not friction.any():
        return gains
    presses = np.zeros(joints)
    if _is_unlimited(controller):
        presses = error_gain(friction, np.asarray(robot.effort_limit), 2.0 * np.pi / 2.0**bits if bits else 0.0)
    reason = "the Coulomb friction of half-warm gears is known"
    if not presses.any():
        return (*gains, Gain("compensation.coulomb", tuple(friction.tolist()), reason))
    coulomb = rounded(np.where(presses > 0.0, _STATIC * friction, friction))
    known = Gain("compensation.coulomb", coulomb, f"{reason}; {_STATIC:g} times, since joints stick")
    return (*gains, known, Gain("compensation.error_gain", rounded(presses), PRESSES))


def error_gain(friction: Array, limits: Array, step: float) -> Array:
    """The rule for `compensation.error_gain`: 0 for joints that do not stick noticeably, shape (joints,), 1/s.

    Args:
        friction: Coulomb friction of each joint, shape (joints,), N m.
        limits: of the effort, likewise.
        step: of the encoders, rad; 0: ideal.
    """
    presses = min(_PRESSES, _STEP_PRESSES * REVERSAL / step) if step > 0.0 else _PRESSES
    return np.where(friction > _STICKS * limits, presses, 0.0)


class Drivetrain(NamedTuple):
    """Motors and gears, arrays of shape (joints,): kg m^2, N m/rad (0: rigid), N m s/rad; where the encoders are."""

    rotor: Array
    stiffness: Array
    damping: Array
    on_motor: bool


def make_drives(rate: float, delay: int, lag: float, train: Drivetrain, observed: bool) -> Drives:
    """What the rule has to know of drives.

    Args:
        rate: joint states per second.
        delay: samples from a measurement to the command that answers it.
        lag: time constant of the drives, s.
        train: motors and gears.
        observed: the observer shall know the springs.
    """
    return Drives(
        period=1.0 / rate,
        delay=min(delay, _LONGEST),
        lag=lag,
        **train._asdict(),
        observed=observed,
        # With encoders at the links, it stays slower if it predicts.
        ahead=min(round(delay + rate * lag + 0.5), _LONGEST) if observed and train.on_motor else 0,
    )


def _lets_observe(controller: Mapping[str, object], on_motor: bool) -> bool:
    """Whether the controller may have an observer that knows the springs.

    Not if it measures torques behind the gears, nor if a limit of the effort's rate leaves too little for it: on the
    Panda and the UR5 with geared joints, it stops below 10/s, one that takes them for rigid below 5/s.
    """
    if not on_motor and controller.get("feedback.effort") == "measured":
        return False
    limits = controller.get("limits.effort", find_robot(controller).effort_limit)
    try:
        rates = np.asarray(controller.get("limits.effort_rate", 0.0), np.float64)
        slow = (rates > 0.0) & (rates < _SLOWEST_RATE * np.asarray(limits, np.float64))
    except (TypeError, ValueError):  # Values of a wrong type or length are refused later.
        return False
    return not slow.any()


def _is_unlimited(controller: Mapping[str, object]) -> bool:
    """Whether no joint has a limit of the effort's rate; a value that cannot be one is refused later."""
    try:
        return not np.asarray(controller.get("limits.effort_rate", 0.0), np.float64).any()
    except (TypeError, ValueError):
        return True


def _current_lag(used: Mapping[str, Value], joints: int) -> Array:
    """The delay of second-order current loops at low frequencies, shape (joints,), s."""
    frequency, damping = (joint_array(used[f"actuator.{name}"], joints) for name in ("frequency", "damping"))
    return np.divide(2.0 * damping, frequency, out=np.zeros(joints), where=frequency > 0.0)
