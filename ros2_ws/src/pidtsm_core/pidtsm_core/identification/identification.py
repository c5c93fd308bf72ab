"""From measurements of an arm to its corrected description."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.identification.base_parameters import BaseParameters, base_parameters
from pidtsm_core.identification.carriers import carriers
from pidtsm_core.identification.consistency import Prior, consistent_parameters, expectation
from pidtsm_core.identification.data_faults import gravity_faults, limited, recording_faults, structure_faults
from pidtsm_core.identification.inseparable import inseparable, like_gravity
from pidtsm_core.identification.least_squares import Fit, fit, motion_regressor
from pidtsm_core.identification.measurement import Measurement, Motion, Piece, bandwidth, filtered, joined
from pidtsm_core.identification.motion_needs import cure, motion_needs, moves_enough, too_short
from pidtsm_core.identification.regressor import described_parameters
from pidtsm_core.identification.reversals import left_out, without_slow_motion
from pidtsm_core.robots import Description, tree
from pidtsm_core.robots.tree.unit_forces import LINK

_APART = 0.8
"""Share of each measurement, from its start, that is fitted; the rest is kept apart to judge the result."""
_FRICTION = 0.2
"""Standard deviation of unknown friction and offsets, as a share of the effort limit."""
_SMALL = 0.1
"""Share of this for an offset that looks as weight, which is more often the weight itself."""
_QUICKEST = 100.0
"""rad/s^2 or m/s^2: the effort limit is taken to accelerate the rotor alone at least so fast."""
_KNOWN = 0.1
"""Standard deviation of rotors that are known otherwise, as a share of them."""
_UNEXPLAINED = 0.3
"""Share of a torque's root mean square that a model of the right arm does not leave unexplained."""
_IMPOSSIBLE = 2.0
"""Ratio of the errors of possible bodies and of any numbers, above which no bodies explain the torques."""
_EXPLAINED = 0.05
"""Share of a torque that nobody misses; a model that leaves less is not refused, however well other numbers do."""
_FAR = 1.5
"""Distance of parameters from data and description, see `consistent_parameters`, above which something is strange. It
stays below in 600 arms whose description is up to 30 % off."""
_ANOTHER = 3.0
"""Distance above which it is another robot; 4.5 and more with the data of a Panda and the description of an xArm7."""
_POOR = 300.0
"""Condition number above which the motion is a poor one."""


class IdentificationError(UsageError):
    """A measurement from which nothing can be identified; the message says why, one reason per line."""


@dataclass(frozen=True)
class Check:
    """A model judged with data that were kept apart, in the bandwidth of the identification.

    Attributes:
        time: s, shape (samples,).
        measured: efforts, shape (samples, joints), N m or N.
        before, after: efforts by the description and by the identified parameters, likewise.
        usable: see `Piece`, likewise.
        motion: see `Piece`.
    """

    time: Array
    measured: Array
    before: Array
    after: Array
    usable: NDArray[np.bool_]
    motion: Motion

    def error(self, predicted: Array) -> Array:
        """Root mean square of the difference between predicted and measured efforts, shape (joints,), N m or N."""
        usable = self.usable | ~self.usable.any(axis=0)
        return np.asarray(np.sqrt(np.mean((predicted - self.measured) ** 2, axis=0, where=usable)))


@dataclass(frozen=True)
class Identification:
    """What measurements say about an arm.

    Attributes:
        arm: its description.
        base: the combinations of parameters that they can say something about.
        fit: estimates of these combinations.
        described: parameters pi of the description, see `regressor`, shape (14 joints,).
        parameters: physically consistent pi nearest to data and description, likewise.
        undetermined: indices in `base` about which the data say less than the description.
        cutoff: bandwidth of the data that were used, Hz.
        check: the result judged with data that were kept apart.
        warnings: sentences.
        notes: likewise, what no motion can tell apart, and what motion is not used.
        as_written: errors of what was written and read back, on the data kept apart, shape (joints,), see
            `written.judged_as_written`; None: nothing was written.
    """

    arm: Description
    base: BaseParameters
    fit: Fit
    described: Array
    parameters: Array
    undetermined: tuple[int, ...]
    cutoff: float
    check: Check
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    as_written: Array | None = None

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the efforts."""
        return tuple("N" if slides else "N m" for slides in self.arm.slides)


def identify(
    arm: Description, measurements: Sequence[Measurement], robot: str = "ROBOT", rotors: Array | None = None
) -> Identification:
    """Identify inertias, armature, friction and offsets of an arm.

    Args:
        arm: its description; its geometry and gravity are taken as right.
        measurements: of its motions; each has the joints of the arm, in any order.
        robot: what ``--robot`` names it, for messages.
        rotors: armature that is known otherwise, to 10 %, in place of the described one, shape (joints,), kg m^2 or kg;
            0: it is not.

    Raises:
        IdentificationError: the measurements cannot be used.
    """
    # The systems are small: several threads of BLAS wait for each other, on a busy machine up to 20 times as long.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(arm, measurements, robot, np.zeros(len(arm.joints)) if rotors is None else rotors)


def _identify(arm: Description, measurements: Sequence[Measurement], robot: str, rotors: Array) -> Identification:
    _, bodies = carriers(arm)
    measured = [limited(_ordered(each, arm), arm.effort) for each in measurements]
    described = described_parameters(arm.tree, arm.damping, arm.friction)
    warnings = _recording_warnings(measured, robot)
    cutoff, needs = _bandwidth_and_needs(arm, measured, robot)
    prior = _with_rotors(Prior(described, bodies, _deviation(arm, measured)), rotors)
    _refuse_structure(arm, prior, measured, cutoff, needs)
    base = base_parameters(arm.tree, len(arm.joints))
    expected = expectation(prior, base)
    measured = without_slow_motion(arm.tree, base, measured, cutoff)
    try:
        found = fit(arm.tree, base, [each.between(0.0, _APART) for each in measured], cutoff, expected)
    except ValueError as error:  # np.linalg.LinAlgError is one.
        told = [] if isinstance(error, np.linalg.LinAlgError) else [str(error)]
        reasons = [*told, *(needs or [cure(robot)])]
        raise IdentificationError("\n".join(["the motion does not suffice", *reasons])) from None
    parameters, distance = consistent_parameters(prior, base, found, _preferred(arm, prior))
    undetermined = np.flatnonzero(found.deviation > expected.deviation)
    pieces = [p for each in measured for p in filtered(each.between(_APART, 1.0), cutoff, found.delay)]
    if not pieces:
        warnings.append("the last fifth is too short to judge the result, which is judged with data that were fitted")
        pieces = [p for each in measured for p in filtered(each, cutoff, found.delay)]
    check = _check(arm, pieces, described, parameters)
    free = _check(arm, pieces, described, _any_parameters(base, found))
    warnings += _warnings(arm, found, distance, (check, free), needs)
    notes = (*inseparable(arm, parameters), *left_out(arm, measured))
    return Identification(
        arm, base, found, described, parameters, tuple(undetermined.tolist()), cutoff, check, tuple(warnings), notes
    )


def _bandwidth_and_needs(arm: Description, measured: Sequence[Measurement], robot: str) -> tuple[float, list[str]]:
    """The bandwidth (Hz) of the motion, and what it lacks; the last sentence of a motion that lacks something cures it.

    Raises:
        IdentificationError: it is too short.
    """
    try:
        cutoff = bandwidth(measured)
    except ValueError as error:
        raise IdentificationError(f"{error}; {cure(robot)}") from None
    fitted = [p for each in measured for p in filtered(each.between(0.0, _APART), cutoff)]
    if not fitted:
        raise IdentificationError(f"{too_short(measured, cutoff)}; {cure(robot)}")
    needs = motion_needs(arm, fitted)
    return cutoff, [*needs, cure(robot)] if needs else []


def _ordered(measurement: Measurement, arm: Description) -> Measurement:
    """The measurement in the order of the arm's joints."""
    if missing := [joint for joint in arm.joints if joint not in measurement.joints]:
        raise IdentificationError(
            f"the joint states lack {', '.join(missing)}, and have {', '.join(measurement.joints)}: is this the bag of "
            "another robot?"
        )
    return measurement.of(arm.joints)


def _recording_warnings(measured: Sequence[Measurement], robot: str) -> list[str]:
    """Faults of recordings that do not prevent identification.

    Raises:
        IdentificationError: others.
    """
    faults = [fault for each in measured for fault in recording_faults(each)]
    if fatal := [fault.text for fault in faults if fault.fatal]:
        raise IdentificationError("\n".join(dict.fromkeys([*fatal, cure(robot)])))
    return [fault.text for fault in faults]


def _refuse_structure(
    arm: Description, prior: Prior, measured: Sequence[Measurement], cutoff: float, needs: Sequence[str]
) -> None:
    """Check order and signs of the joints, and gravity.

    Raises:
        IdentificationError: they are wrong.
    """
    for each in measured:
        for piece in filtered(each, cutoff)[:1]:
            faults = [*structure_faults(arm.tree, prior.parameters, arm.joints, piece.motion)]
            if faults := faults or [*gravity_faults(arm.tree, prior, piece.motion)]:
                texts = [fault.text for fault in faults]
                if needs:
                    told = "the motion is too poor to judge; it looks as if"
                    raise IdentificationError("\n".join([*needs, *(f"{told} {text}" for text in texts)]))
                raise IdentificationError("\n".join([*texts, "if that is not so, is this the bag of another robot?"]))


def _deviation(arm: Description, measured: Sequence[Measurement]) -> Array:
    """How uncertain armature, friction and offsets are, shape (4 joints,)."""
    joints = len(arm.joints)
    largest = np.max([np.abs(each.effort).max(axis=0) for each in measured], axis=0)
    limit = np.maximum(np.where(np.isfinite(arm.effort), arm.effort, largest), 1e-6)
    inertia = np.zeros((joints, joints))
    tree.inertia_matrix(measured[0].position[0].copy(), arm.tree.copy(), inertia)
    rotor = np.maximum(np.diag(inertia), limit / _QUICKEST)
    return np.concatenate([rotor, *[_FRICTION * limit] * 3])


def _with_rotors(prior: Prior, rotors: Array) -> Prior:
    """What the description says, but for rotors that are known otherwise, see `identify`."""
    parameters, deviation, known = prior.parameters.copy(), prior.deviation.copy(), np.flatnonzero(rotors > 0.0)
    parameters[LINK * rotors.size + known] = rotors[known]
    deviation[known] = _KNOWN * rotors[known]
    return replace(prior, parameters=parameters, deviation=deviation)


def _preferred(arm: Description, prior: Prior) -> Array:
    """Deviations by which what no motion can tell apart is divided: gravity tells the mass of what a joint lifts."""
    preferred = prior.deviation.copy()
    preferred[-len(arm.joints) :] *= np.where(like_gravity(arm), _SMALL, 1.0)
    return preferred


def _any_parameters(base: BaseParameters, found: Fit) -> Array:
    """Numbers pi with the estimated base parameters, which no body need have."""
    parameters = np.zeros(base.mapping.shape[1])
    parameters[base.columns] = found.beta
    return parameters


def _check(arm: Description, pieces: Sequence[Piece], before: Array, after: Array) -> Check:
    """Compare two sets of parameters pi with data."""
    matrices = [motion_regressor(arm.tree, piece.motion) for piece in pieces]
    matrix = np.concatenate(matrices)
    return Check(
        time=np.concatenate([piece.time for piece in pieces]),
        measured=np.concatenate([piece.motion.effort for piece in pieces]),
        before=matrix @ before,
        after=matrix @ after,
        usable=np.concatenate([piece.usable for piece in pieces]),
        motion=joined([piece.motion for piece in pieces]),
    )


def _warnings(
    arm: Description, found: Fit, distance: float, checks: tuple[Check, Check], needs: Sequence[str]
) -> list[str]:
    """What is doubtful about a result.

    Raises:
        IdentificationError: the model does not explain the torques.
    """
    check, free = checks
    size = np.sqrt(np.mean(check.measured**2, axis=0)) + 1e-12
    after, any_numbers = check.error(check.after) / size, free.error(free.after) / size
    # Nothing is said of the friction of joints that stand still, which holds them.
    moving = moves_enough(check.motion.position)
    bad = (any_numbers > _UNEXPLAINED) & moving
    shares = np.where(moving, after, 0.0), np.where(moving, any_numbers, 0.0)
    if refusal := _refusal(arm, distance, *shares, bool(needs)):
        fact, guess = refusal
        # Poor data explain nothing well, of the right arm neither.
        reasons = [*needs, f"with such a motion, {fact}"] if needs else [f"{fact}: {guess}"]
        raise IdentificationError("\n".join(reasons))
    warnings = [
        f"{100.0 * share:.0f} % of the torque of {joint} is unexplained"
        for joint, share, is_bad in zip(arm.joints, any_numbers, bad, strict=True)
        if is_bad
    ]
    if needs:
        warnings += [*needs[:-1], f"what this motion does not show stays as the description has it; {needs[-1]}"]
    if distance > _FAR:
        guess = "" if needs else ": is this the bag of another robot, or does the arm carry something?"
        warnings.append(f"{_disagreement(distance)}{guess}")
    if found.condition > _POOR and not needs:
        warnings.append(
            f"the motion is a poor one (condition number {found.condition:.0f}); ./pidtsm excite makes a better one"
        )
    is_worse = (after > check.error(check.before) / size) & (after > _EXPLAINED) & moving
    worse = [joint for joint, is_one in zip(arm.joints, is_worse, strict=True) if is_one]
    if worse:
        warnings.append(f"on data kept apart, the description predicts the torque of {', '.join(worse)} better")
    return warnings


def _refusal(
    arm: Description, distance: float, after: Array, any_numbers: Array, is_poor: bool
) -> tuple[str, str] | None:
    """Why the model does not explain the torques, and what may be the reason; None if it does.

    Args:
        arm: its description.
        distance: see `consistent_parameters`.
        after: share of the torque that the identified parameters leave unexplained, shape (joints,).
        any_numbers: the same of numbers that no body need have.
        is_poor: whether the motion lacks something.
    """
    bad = any_numbers > _UNEXPLAINED
    useless = is_poor and min(after.max(), any_numbers.max()) > 1.0
    if np.count_nonzero(bad) > len(arm.joints) // 2 or useless or (distance > _FAR and bad.any()):
        shares = [
            f"{joint} {100.0 * max(0.0, 1.0 - e):.0f} %" for joint, e in zip(arm.joints, any_numbers, strict=True)
        ]
        return (
            f"no parameters of this arm explain the torques (explained: {', '.join(shares)})",
            "are the joints in another order, is this the bag of another robot, or does the description have other "
            "lengths or axes?",
        )
    if distance > _ANOTHER:
        return (
            _disagreement(distance),
            "is this the bag of another robot, does the description have other lengths or axes, or did something else "
            "act on the arm, such as a disturbance or a contact?",
        )
    ratio = np.sqrt(np.mean(after**2) / (np.mean(any_numbers**2) + 1e-30))
    if ratio > _IMPOSSIBLE and after.max() > _EXPLAINED:
        return (
            f"no bodies explain the torques: with possible masses and inertias the error is {ratio:.1f} times that "
            "with any numbers",
            "is this the bag of another robot, or is a sign wrong?",
        )
    return None


def _disagreement(distance: float) -> str:
    return f"data and description disagree {distance:.1f} times as much as they should"
