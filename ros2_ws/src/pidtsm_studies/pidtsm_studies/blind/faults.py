"""The faults that a blind arm may have; each changes a draft so much that it matters, and says what it did."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pidtsm_core.robots.payload import Payload
from pidtsm_studies.blind.description import (
    of_another_build,
    with_flipped_axis,
    with_masses,
    with_moved_centres,
    with_swapped_names,
)
from pidtsm_studies.blind.draft import Draft, of_class
from pidtsm_studies.diagnosis.causes import Cause

_MATTERS = 0.35
"""Least effect of a wrong model, see `Draft.effect`."""
_CARRIED = 0.8
"""Share of its limit that a changed arm may need of a drive."""
_TRIES = 60
_RATE = 50.0
"""Hz, of a stream of targets that jitters."""
_RATE_OF_DEFAULT = 1000.0


@dataclass(frozen=True)
class Planted:
    """A fault that a blind arm has.

    Attributes:
        cause: what it is.
        joints: names of the joints that have it; empty: the whole arm.
        text: what was done.
    """

    cause: Cause
    joints: tuple[str, ...]
    text: str


class NoEffectError(ValueError):
    """A fault that would not matter for this arm and motion."""


def lost_samples(draft: Draft, random: np.random.Generator) -> Planted:
    """Measurements that never arrive: single ones, or bursts."""
    if random.random() < 0.5:
        share = float(random.uniform(0.02, 0.1))
        draft.simulator["dropout.probability"] = share
        return Planted(Cause.LOST_SAMPLES, (), f"{100.0 * share:.1f} % of the measurements are lost")
    burst, rate = int(random.integers(3, 8)), float(random.uniform(1.0, 4.0))
    draft.simulator |= {"dropout.burst": burst, "dropout.burst_rate": rate}
    return Planted(Cause.LOST_SAMPLES, (), f"{rate:.1f} bursts a second of {burst} lost measurements")


def noisy_encoder(draft: Draft, random: np.random.Generator) -> Planted:
    """White noise of one encoder, several steps of it."""
    j = int(random.integers(len(draft.arm.joints)))
    step = 2.0 * np.pi / 2.0 ** of_class(draft.hardware, "encoder.bits", 17)
    noise = float(random.uniform(2.0, 4.0) * max(step, 3e-4))
    values = np.zeros(len(draft.arm.joints))
    values[j] = noise
    draft.simulator["noise.std"] = values.tolist()
    return Planted(Cause.NOISY_ENCODER, (draft.arm.joints[j],), f"noise of {1e3 * noise:.2f} mrad")


def command_jitter(draft: Draft, random: np.random.Generator) -> Planted:
    """A stream of targets at 50 Hz whose points scatter."""
    size = float(random.uniform(5e-4, 3e-3))
    time = np.arange(0.0, draft.duration + 1.0, 1.0 / _RATE)
    points = draft.motion(time)[0]
    points[1:] += size * random.standard_normal(points[1:].shape)
    draft.points = np.column_stack([time, points])
    return Planted(Cause.COMMAND_JITTER, (), f"targets at {_RATE:.0f} Hz scatter by {1e3 * size:.2f} mrad")


def saturation(draft: Draft, random: np.random.Generator) -> Planted:
    """A drive that delivers less than the motion needs.

    Raises:
        NoEffectError: no joint needs much effort.
    """
    needed = np.abs(draft.efforts(draft.plant)).max(axis=0)
    heavy = np.flatnonzero(needed > 0.08 * draft.limit)
    if not heavy.size:
        raise NoEffectError("no joint needs much effort")
    j = int(random.choice(heavy))
    share = float(random.uniform(0.75, 0.9))
    values = draft.limit.copy()
    values[j] = share * needed[j]
    draft.simulator["limits.effort"] = values.tolist()
    text = f"its drive delivers {values[j]:.3g}, {100.0 * share:.0f} % of what the motion needs"
    return Planted(Cause.SATURATION, (draft.arm.joints[j],), text)


def late_drive(draft: Draft, random: np.random.Generator) -> Planted:
    """Commands that act late, by a delay or by a lag."""
    late = float(random.uniform(0.02, 0.035))
    if random.random() < 0.5:
        rate = of_class(draft.hardware, "rate", _RATE_OF_DEFAULT)
        draft.simulator["delay.command_samples"] = round(late * rate)
        return Planted(Cause.LATE_DRIVE, (), f"commands act {1e3 * late:.0f} ms late")
    draft.simulator["actuator.lag"] = late
    return Planted(Cause.LATE_DRIVE, (), f"drives lag by {1e3 * late:.0f} ms")


def ringing(draft: Draft, random: np.random.Generator) -> Planted:
    """Gains so high that the loop oscillates; the joints and the factor follow from trials, see `arms`."""
    j = int(random.integers(len(draft.arm.joints)))
    draft.rings = j
    return Planted(Cause.RINGING, (draft.arm.joints[j],), "gains are too high")


def stick_slip(draft: Draft, random: np.random.Generator) -> Planted:
    """A joint that sticks: static friction far above Coulomb friction, at a slow motion."""
    j = int(random.integers(len(draft.arm.joints)))
    limit, count = draft.limit[j], len(draft.arm.joints)
    share = float(random.uniform(0.15, 0.25))
    static, coulomb, bristle, speed = (np.zeros(count) for _ in range(4))
    dry = draft.friction
    stiffness = of_class(draft.hardware, "friction.bristle_stiffness", 0.0)
    static[:] = coulomb[:] = dry * draft.limit
    bristle[:] = stiffness * draft.limit
    speed[:] = of_class(draft.hardware, "friction.stribeck_velocity", 0.02)
    static[j], coulomb[j] = coulomb[j] + share * limit, coulomb[j]
    bristle[j], speed[j] = max(stiffness, 1000.0) * limit, 0.05
    draft.simulator |= {
        "friction.static": static.tolist(),
        "friction.coulomb": coulomb.tolist(),
        "friction.bristle_stiffness": bristle.tolist(),
        "friction.stribeck_velocity": speed.tolist(),
    }
    draft.frequency[j] = 0.1
    draft.amplitude[j] = min(draft.amplitude[j], float(random.uniform(0.05, 0.1)))
    text = f"static friction is {100.0 * share:.0f} % of the limit more"
    return Planted(Cause.STICK_SLIP, (draft.arm.joints[j],), text)


def wrong_sign(draft: Draft, random: np.random.Generator) -> Planted:
    """A joint that turns the other way than its description says.

    Raises:
        NoEffectError: no sign matters for the motion.
    """
    for j in random.permutation(len(draft.arm.joints)).tolist():
        joint = draft.arm.joints[j]
        plant = with_flipped_axis(draft.plant, joint)
        if draft.effect(plant) > _MATTERS:
            draft.plant = plant
            return Planted(Cause.WRONG_SIGN, (joint,), "it turns the other way")
    raise NoEffectError("no joint's sign matters for this motion")


def wrong_order(draft: Draft, random: np.random.Generator) -> Planted:
    """Two joints whose connectors are exchanged.

    Raises:
        NoEffectError: no order matters for the motion.
    """
    pairs = list(combinations(draft.arm.joints, 2))
    alike = draft.arm.slides
    for k in random.permutation(len(pairs)).tolist():
        first, second = pairs[k]
        if alike[draft.arm.joints.index(first)] != alike[draft.arm.joints.index(second)]:
            continue
        plant = with_swapped_names(draft.plant, first, second)
        if draft.effect(plant) > _MATTERS:
            draft.plant = plant
            return Planted(Cause.WRONG_ORDER, (first, second), "they are exchanged")
    raise NoEffectError("no order of the joints matters for this motion")


def other_arm(draft: Draft, random: np.random.Generator) -> Planted:
    """An arm with other lengths, axes and masses than its description says."""
    return _changed(draft, lambda: of_another_build(draft.plant, random), Cause.OTHER_ARM, "lengths and axes differ")


def wrong_gravity(draft: Draft, random: np.random.Generator) -> Planted:
    """Masses or centres of mass that the description has wrong."""
    names = [draft.arm.links.names[i] for i in np.flatnonzero(draft.arm.links.rows >= 0)]
    if random.random() < 0.5:
        factor = float(random.choice([random.uniform(0.5, 0.7), random.uniform(1.35, 1.6)]))
        change = lambda: with_masses(draft.plant, dict.fromkeys(names, factor))  # noqa: E731
        return _changed(draft, change, Cause.WRONG_GRAVITY, f"masses are {factor:.2f} times those described")

    def moved() -> str:
        return with_moved_centres(draft.plant, {name: random.uniform(-0.12, 0.12, 3).tolist() for name in names})

    return _changed(draft, moved, Cause.WRONG_GRAVITY, "centres of mass are elsewhere, by up to 12 cm")


def unknown_payload(draft: Draft, random: np.random.Generator) -> Planted:
    """Something at the tool that the controller does not know.

    Raises:
        NoEffectError: no payload that the drives can carry matters.
    """
    mass = 0.2
    while draft.effect(payload=Payload(mass, np.zeros(3))) < _MATTERS:
        mass *= 1.2
        if mass > 30.0 or not _carries(draft, Payload(1.5 * mass, np.zeros(3))):
            raise NoEffectError("a payload does not matter for this motion")
    mass *= float(random.uniform(1.0, 1.5))
    draft.simulator["payload.mass"] = mass
    return Planted(Cause.UNKNOWN_PAYLOAD, (), f"{mass:.2f} kg at the tool")


def _carries(draft: Draft, payload: Payload) -> bool:
    """Whether the drives can move the arm with a payload."""
    return bool(np.all(np.abs(draft.efforts(payload=payload)).max(axis=0) < _CARRIED * draft.limit))


def _changed(draft: Draft, change: Callable[[], str], cause: Cause, text: str) -> Planted:
    """Take the first change of the plant that matters, and that its drives can carry.

    Raises:
        NoEffectError: there is none.
    """
    for _ in range(_TRIES):
        plant = change()
        needed = np.abs(draft.efforts(plant)).max(axis=0)
        if draft.effect(plant) > _MATTERS and np.all(needed < _CARRIED * draft.limit):
            draft.plant = plant
            return Planted(cause, (), text)
    raise NoEffectError(f"no such change matters: {text}")


FAULTS: dict[Cause, Callable[[Draft, np.random.Generator], Planted]] = {
    Cause.LOST_SAMPLES: lost_samples,
    Cause.NOISY_ENCODER: noisy_encoder,
    Cause.COMMAND_JITTER: command_jitter,
    Cause.SATURATION: saturation,
    Cause.LATE_DRIVE: late_drive,
    Cause.RINGING: ringing,
    Cause.STICK_SLIP: stick_slip,
    Cause.WRONG_SIGN: wrong_sign,
    Cause.WRONG_ORDER: wrong_order,
    Cause.OTHER_ARM: other_arm,
    Cause.WRONG_GRAVITY: wrong_gravity,
    Cause.UNKNOWN_PAYLOAD: unknown_payload,
}
"""Every fault, by its cause."""
_OF_MODEL = {Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM, Cause.WRONG_GRAVITY, Cause.UNKNOWN_PAYLOAD}
_OF_STRUCTURE = {Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM}
_OF_LOOP = {Cause.LATE_DRIVE, Cause.RINGING, Cause.STICK_SLIP}


def compatible(causes: Sequence[Cause]) -> bool:
    """Whether faults can be told apart when they come together: at most one of the model, and one of the loop.

    With wrong signs, or the description of another arm, a loop oscillates and saturates, whatever its gains are; noise
    and jitter make it ring.
    """
    chosen = set(causes)
    if len(chosen) < len(causes) or (_OF_STRUCTURE & chosen and (_OF_LOOP | {Cause.SATURATION}) & chosen):
        return False
    if Cause.RINGING in chosen and chosen & {Cause.NOISY_ENCODER, Cause.COMMAND_JITTER}:
        return False
    return not any(len(chosen & group) > 1 for group in (_OF_MODEL, _OF_LOOP))
