"""Verdicts on everything that may be wrong with a loop, and which of them are only consequences."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.robots import Description
from pidtsm_studies.diagnosis.causes import NAMES, Cause
from pidtsm_studies.diagnosis.detectors.lateness import late_drive
from pidtsm_studies.diagnosis.detectors.losses import lost_samples
from pidtsm_studies.diagnosis.detectors.model import model_verdicts
from pidtsm_studies.diagnosis.detectors.noise import noisy_encoder
from pidtsm_studies.diagnosis.detectors.reference import command_jitter
from pidtsm_studies.diagnosis.detectors.ringing import ringing
from pidtsm_studies.diagnosis.detectors.saturated import saturation
from pidtsm_studies.diagnosis.detectors.sticking import stick_slip
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.observed import Observed
from pidtsm_studies.diagnosis.verdict import State, Verdict, too_short, unknown

SHORTEST = 3.0
"""s of a recording that can be judged."""
_SHOWN_BY_FOLLOWING = (Cause.NOISY_ENCODER, Cause.SATURATION, Cause.RINGING, Cause.STICK_SLIP)
"""What a loop shows that follows for some time; a stop is too violent."""
_DISTURBING = {Cause.COMMAND_JITTER, Cause.RINGING}
"""What makes motion so fast that friction and gears show, which no model has."""
_VIOLENT = 0.3
"""rad/s or m/s of a loop that rings so much that no friction holds it."""
_ANOTHER_ARM = {Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM}
_CONSEQUENCES = (
    (_ANOTHER_ARM, {Cause.RINGING, Cause.STICK_SLIP, Cause.SATURATION}),
    ({Cause.LATE_DRIVE}, {Cause.RINGING, Cause.STICK_SLIP}),
    ({Cause.STICK_SLIP, Cause.NOISY_ENCODER, Cause.COMMAND_JITTER}, {Cause.RINGING}),
)
"""What makes a loop oscillate, and what then is no cause of its own: a joint that rings hardly ever stands still, and
noise and jitter make every loop near its margin ring; with another arm, it needs other efforts."""


@dataclass(frozen=True)
class Diagnosis:
    """The verdicts on a recording.

    Attributes:
        verdicts: on every cause, those found first.
        duration: s that were judged.
        rate: of the joint states, Hz.
        joints: names.
        stopped: why the controller has stopped; empty: it has not.
    """

    verdicts: tuple[Verdict, ...]
    duration: float
    rate: float
    joints: tuple[str, ...]
    stopped: str

    @property
    def found(self) -> tuple[Verdict, ...]:
        """What is wrong."""
        return tuple(each for each in self.verdicts if each.state is State.FOUND)

    @property
    def is_good(self) -> bool:
        """Whether nothing is wrong with what the recording shows."""
        return not self.found and not self.stopped


def diagnose(observed: Observed, arm: Description | None = None, robot: str = "ROBOT") -> Diagnosis:
    """Judge a recording.

    Args:
        observed: what was recorded.
        arm: what the controller believes of the arm, with the payload that it knows; None: the model is not judged.
        robot: what ``--robot`` names it, for cures.

    Raises:
        UsageError: the recording is too short or not finite, or is of an arm with other joints.
    """
    if arm is not None:
        if missing := [joint for joint in arm.joints if joint not in observed.joints]:
            raise UsageError(
                f"the joint states lack {', '.join(missing)}, and have {', '.join(observed.joints)}: is this the "
                "recording of another robot?"
            )
        observed = replace(observed.of(arm.joints), slides=tuple(arm.slides.tolist()))
    if observed.time.size < 2 or observed.time[-1] - observed.time[0] < SHORTEST:
        raise UsageError(f"the recording is shorter than {SHORTEST:g} s; record a motion of 20 s or more")
    loop = Loop(observed)
    limit = None if arm is None else np.where(np.isfinite(arm.effort), arm.effort, np.inf)
    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        # A joint that stands still has no spectrum.
        warnings.simplefilter("ignore", RuntimeWarning)
        late = late_drive(loop)
        verdicts = [lost_samples(loop), command_jitter(loop), late]
        if loop.follows:
            verdicts += _of_following(loop, limit, late.value if late.found else 0.0)
        else:
            verdicts += [unknown(cause, too_short(loop)) for cause in _SHOWN_BY_FOLLOWING]
        disturbed = not _DISTURBING.isdisjoint(each.cause for each in verdicts if each.found)
        verdicts += model_verdicts(loop, arm, robot, disturbed)
    ordered = sorted(_without_consequences(verdicts), key=lambda each: (not each.found, each.state is State.FINE))
    return Diagnosis(tuple(ordered), loop.duration, loop.rate, observed.joints, observed.stopped)


def _of_following(loop: Loop, limit: Array | None, late: float) -> list[Verdict]:
    """Verdicts on `_SHOWN_BY_FOLLOWING`; effort limits of the description, and s by which the drives are late."""
    saturated = saturation(Loop(loop.observed, before_stop=0.0), limit, late)
    rings = ringing(loop)
    violently = rings.found and rings.value > _VIOLENT
    return [noisy_encoder(loop), saturated, rings, stick_slip(loop, saturated.found, violently)]


def _without_consequences(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """The verdicts, of which those that follow from others do not count as found."""
    found = {each.cause for each in verdicts if each.found}
    reasons: dict[Cause, Cause] = {}
    for causes, consequences in _CONSEQUENCES:
        for reason in sorted(causes & found - set(reasons)):
            reasons |= dict.fromkeys(consequences & found, reason)
    return [
        replace(
            each,
            state=State.FINE,
            text=f"{each.text}, which may follow from: {NAMES[reasons[each.cause]]}; repair that first",
            cure="",
        )
        if each.cause in reasons
        else each
        for each in verdicts
    ]
