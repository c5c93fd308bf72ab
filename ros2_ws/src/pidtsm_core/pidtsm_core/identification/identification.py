"""From measurements of an arm to its corrected description."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.identification.base_parameters import BaseParameters, base_parameters
from pidtsm_core.identification.consistency import Prior, consistent_parameters, expectation
from pidtsm_core.identification.corrected_urdf import carriers
from pidtsm_core.identification.data_faults import gravity_faults, limited, recording_faults, structure_faults
from pidtsm_core.identification.least_squares import Fit, fit, motion_regressor
from pidtsm_core.identification.measurement import Measurement, Piece, bandwidth, filtered
from pidtsm_core.identification.regressor import described_parameters
from pidtsm_core.robots import Description, tree

_APART = 0.8
"""Share of each measurement, from its start, that is fitted; the rest is kept apart to judge the result."""
_FRICTION = 0.2
"""Standard deviation of unknown friction and offsets, as a share of the effort limit."""
_QUICKEST = 100.0
"""rad/s^2 or m/s^2: the effort limit is taken to accelerate the rotor alone at least so fast."""
_UNEXPLAINED = 0.3
"""Share of a torque's root mean square that a model of the right arm does not leave unexplained."""
_IMPOSSIBLE = 2.0
"""Ratio of the errors of possible bodies and of any numbers, above which no bodies explain the torques."""
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
    """

    time: Array
    measured: Array
    before: Array
    after: Array
    usable: NDArray[np.bool_]

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


def identify(arm: Description, measurements: Sequence[Measurement]) -> Identification:
    """Identify inertias, armature, friction and offsets of an arm.

    Args:
        arm: its description, a URDF; its geometry and gravity are taken as right.
        measurements: of its motions; each has the joints of the arm, in any order.

    Raises:
        IdentificationError: the measurements cannot be used.
        UsageError: see `carriers`.
    """
    # The systems are small: several threads of BLAS wait for each other, on a busy machine up to 20 times as long.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(arm, measurements)


def _identify(arm: Description, measurements: Sequence[Measurement]) -> Identification:
    _, bodies = carriers(arm)
    measured = [limited(_ordered(each, arm), arm.effort) for each in measurements]
    described = described_parameters(arm.tree, arm.damping, arm.friction)
    warnings = _recording_warnings(measured)
    try:
        cutoff = bandwidth(measured)
    except ValueError as error:
        raise IdentificationError(str(error)) from None
    prior = Prior(described, bodies, _deviation(arm, measured))
    _refuse_structure(arm, prior, measured, cutoff)
    base = base_parameters(arm.tree, len(arm.joints))
    expected = expectation(prior, base)
    try:
        found = fit(arm.tree, base, [each.between(0.0, _APART) for each in measured], cutoff, expected)
    except np.linalg.LinAlgError:
        raise IdentificationError(
            "the motion does not suffice: it leaves the parameters or the noise of the torque undetermined; record a "
            "longer motion of all joints, such as that of ./pidtsm excite"
        ) from None
    except ValueError as error:
        raise IdentificationError(str(error)) from None
    parameters, distance = consistent_parameters(prior, base, found)
    undetermined = np.flatnonzero(found.deviation > expected.deviation)
    pieces = [p for each in measured for p in filtered(each.between(_APART, 1.0), cutoff, found.delay)]
    pieces = pieces or [p for each in measured for p in filtered(each, cutoff, found.delay)]
    check = _check(arm, pieces, described, parameters)
    free = _check(arm, pieces, described, _any_parameters(base, found))
    warnings += _warnings(arm, found, distance, check, free)
    return Identification(
        arm, base, found, described, parameters, tuple(undetermined.tolist()), cutoff, check, tuple(warnings)
    )


def _ordered(measurement: Measurement, arm: Description) -> Measurement:
    """The measurement in the order of the arm's joints."""
    if missing := [joint for joint in arm.joints if joint not in measurement.joints]:
        raise IdentificationError(
            f"the joint states lack {', '.join(missing)}, and have {', '.join(measurement.joints)}: is this the bag of "
            "another robot?"
        )
    return measurement.of(arm.joints)


def _recording_warnings(measured: Sequence[Measurement]) -> list[str]:
    """Faults of recordings that do not prevent identification.

    Raises:
        IdentificationError: others.
    """
    faults = [fault for each in measured for fault in recording_faults(each)]
    if fatal := [fault.text for fault in faults if fault.fatal]:
        raise IdentificationError("\n".join(dict.fromkeys(fatal)))
    return [fault.text for fault in faults]


def _refuse_structure(arm: Description, prior: Prior, measured: Sequence[Measurement], cutoff: float) -> None:
    """Check order and signs of the joints, and gravity.

    Raises:
        IdentificationError: they are wrong.
    """
    for each in measured:
        for piece in filtered(each, cutoff)[:1]:
            faults = [*structure_faults(arm.tree, prior.parameters, arm.joints, piece.motion)]
            if faults := faults or [*gravity_faults(arm.tree, prior, piece.motion)]:
                texts = [fault.text for fault in faults]
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
    )


def _warnings(arm: Description, found: Fit, distance: float, check: Check, free: Check) -> list[str]:
    """What is doubtful about a result.

    Raises:
        IdentificationError: the model does not explain the torques.
    """
    after, any_numbers = check.error(check.after), free.error(free.after)
    size = np.sqrt(np.mean(check.measured**2, axis=0)) + 1e-12
    bad = any_numbers / size > _UNEXPLAINED
    far = distance > _FAR
    if np.count_nonzero(bad) > len(arm.joints) // 2 or (far and bad.any()):
        shares = ", ".join(
            f"{joint} {100.0 * (1.0 - e):.0f} %" for joint, e in zip(arm.joints, any_numbers / size, strict=True)
        )
        raise IdentificationError(
            f"no parameters of this arm explain the torques (explained: {shares}): are the joints in "
            "another order, is this the bag of another robot, or does the description have other lengths or axes?"
        )
    disagreement = f"data and description disagree {distance:.1f} times as much as they should"
    if distance > _ANOTHER:
        raise IdentificationError(
            f"{disagreement}: is this the bag of another robot, does the description have other lengths or axes, or "
            "did something else act on the arm, such as a disturbance or a contact?"
        )
    ratio = np.sqrt(np.mean((after / size) ** 2) / np.mean((any_numbers / size) ** 2))
    if ratio > _IMPOSSIBLE:
        raise IdentificationError(
            f"no bodies explain the torques: with possible masses and inertias the error is {ratio:.1f} times that "
            "with any numbers. Is this the bag of another robot, or is a sign wrong?"
        )
    warnings = [
        f"{100.0 * e:.0f} % of the torque of {joint} is unexplained"
        for joint, e, is_bad in zip(arm.joints, any_numbers / size, bad, strict=True)
        if is_bad
    ]
    if far:
        warnings.append(f"{disagreement}: is this the bag of another robot, or does the arm carry something?")
    if found.condition > _POOR:
        warnings.append(
            f"the motion is a poor one (condition number {found.condition:.0f}); ./pidtsm excite makes a better one"
        )
    worse = [joint for joint, a, b in zip(arm.joints, after, check.error(check.before), strict=True) if a > b]
    if worse:
        warnings.append(f"on data kept apart, the description predicts the torque of {', '.join(worse)} better")
    return warnings
