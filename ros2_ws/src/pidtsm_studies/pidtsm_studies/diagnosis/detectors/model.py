"""What is wrong with the model: signs, order, another arm, masses, or a payload; one estimate tells them apart.

The description leaves a part of the effort unexplained. Of all that may be wrong, what explains most of it with the
fewest numbers is the cause: another sign or order needs none, a payload four, masses and centres ten for each link.
Lengths and axes are in no number: if much is left with all masses that a description may have wrong, it is that of
another arm.
"""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.robots import Description
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.model_fit import ModelFit, TooLittleMotionError, fit_models
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict, too_short, unknown

_RIGHT, _RIGHT_WORST = 0.037, 0.08
"""Shares of the efforts, of all joints and of the worst, that no description explains: cogging, and masses that
are some percent off."""
_DISTURBED = 2.5
"""Factor of both where the reference jitters or the loop rings: fast motion shows friction and gears that no model
has."""
_STRUCTURE = 0.35
"""Share of the unexplained effort that may remain with the right signs and order."""
_PAYLOAD = 0.4
"""Share of what the description leaves that may remain with a payload."""
_FARTHEST = 0.5
"""m from the tool to the centre of a payload."""
_LIGHTEST = 0.05
"""kg."""
_NEAR = 0.046
"""Share that the right geometry leaves, with masses that a description may have wrong."""
_ANOTHER = 0.06
"""Share that the description of another arm leaves at least; of less, friction is the reason."""
_BETTER_THAN_FREE = 0.7
"""Of what free masses leave, the share that the right signs and order may leave."""
_SEEN, _CLEARLY = 0.012, 0.33
"""Share from which on masses count that explain clearly more than the description, or a factor of all its masses, does:
they may leave this share of it. Signs and order count from there on, too."""
_AT_LIMIT, _OFTEN, _LAST = 0.98, 0.1, 1.0
"""Share of an effort limit that counts as it, share of the samples of a loop that bangs against it, and s of such a
loop that are judged."""
_VIOLENT, _REMAINS, _EXPLAINED = 0.2, 0.12, 0.5
"""Share that wrong signs or a wrong order leave of violent motion at least; what the right ones leave at most, of that
and at all."""
CAUSES = (Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM, Cause.WRONG_GRAVITY, Cause.UNKNOWN_PAYLOAD)
"""Of these verdicts, in their order."""
_TOO_VIOLENT = "the arm moves too violently; repair signs and order first"
_NO_ARM = "the arm is not known; name it with --robot"
_SHOWN = 3
"""Joints of the plot."""


def model_verdicts(loop: Loop, arm: Description | None, robot: str, disturbed: bool) -> list[Verdict]:
    """Verdicts on `CAUSES`.

    Args:
        loop: the recording; if there is an arm, with its joints in its order.
        arm: what the controller believes; None: it is not known.
        robot: what ``--robot`` names it, for cures.
        disturbed: whether the reference jitters or the loop rings.
    """
    if arm is None:
        return [unknown(cause, _NO_ARM) for cause in CAUSES]
    if (violent := _violent(loop, arm)) is not None:
        found = _structure(violent)
        return [
            _verdict(cause, violent, loop, robot) if cause in found else unknown(cause, _TOO_VIOLENT)
            for cause in CAUSES
        ]
    if not loop.follows:
        return [unknown(cause, too_short(loop)) for cause in CAUSES]
    try:
        fit = fit_models(arm, loop)
    except TooLittleMotionError as error:
        return [unknown(cause, str(error)) for cause in CAUSES]
    found = _cause(fit, _DISTURBED if disturbed else 1.0)
    return [_verdict(cause, fit, loop, robot) if cause in found else _fine(cause, fit) for cause in CAUSES]


def _violent(loop: Loop, arm: Description) -> ModelFit | None:
    """The models of a stop, or of a loop that bangs against its limits, if other signs or another order explain it.

    Such motion is too violent for all other causes.
    """
    at_limit = np.mean(np.abs(loop.effort) >= _AT_LIMIT * arm.effort, axis=0)
    part = loop.around_stop()
    if part is None and at_limit.max() > _OFTEN:
        part = loop.last(_LAST)
    if part is None:
        return None
    try:
        fit = fit_models(arm, part, violent=True)
    except TooLittleMotionError:
        return None
    # A loop that has followed for some time hardly has wrong signs: they must explain the rest, too.
    enough = min(_REMAINS * fit.described, _EXPLAINED if loop.follows else np.inf)
    return fit if fit.changes and fit.restructured < enough and fit.described > _VIOLENT else None


def _structure(fit: ModelFit) -> Sequence[Cause]:
    """Wrong signs or order, as far as other ones explain more."""
    return tuple(dict.fromkeys(Cause.WRONG_ORDER if each.kind == "order" else Cause.WRONG_SIGN for each in fit.changes))


def _cause(fit: ModelFit, patience: float) -> Sequence[Cause]:
    """What is wrong with the model; empty: nothing. `patience`: factor of the shares that no description explains."""
    left, simple = min(fit.payload, fit.bodies), min(fit.described, fit.scaled)
    # With the right signs and order, the description is as good as any, and better than one with free masses.
    enough = max(_STRUCTURE * fit.described, _BETTER_THAN_FREE * left)
    if fit.changes and fit.described > _SEEN and fit.restructured < enough:
        return _structure(fit)
    # What nothing but other masses explains is no disturbance.
    explained = simple > _SEEN and left < _CLEARLY * simple
    if fit.described < patience * _RIGHT and fit.worst < patience * _RIGHT_WORST and not explained:
        return ()
    # Four numbers that explain more than all masses do that a description may have wrong.
    is_simplest = fit.payload < min(_PAYLOAD * fit.described, fit.near)
    if is_simplest and fit.mass > _LIGHTEST and np.linalg.norm(fit.center) < _FARTHEST:
        return (Cause.UNKNOWN_PAYLOAD,)
    if fit.near < _NEAR:
        return (Cause.WRONG_GRAVITY,)
    return (Cause.OTHER_ARM,) if fit.described > patience * _ANOTHER else ()


def _fine(cause: Cause, fit: ModelFit) -> Verdict:
    return Verdict(
        cause,
        State.FINE,
        f"the description explains the efforts but for {100.0 * fit.described:.2g} %",
        value=fit.described,
        limit=_RIGHT,
    )


def _verdict(cause: Cause, fit: ModelFit, loop: Loop, robot: str) -> Verdict:
    text, cure, joints = _words(cause, fit, loop, robot)
    return Verdict(cause, State.FOUND, text, joints, fit.described, _RIGHT, "", cure, (_plot(fit, loop),))


def _words(cause: Cause, fit: ModelFit, loop: Loop, robot: str) -> tuple[str, str, tuple[str, ...]]:
    """Sentence, cure and joints of a cause that was found."""
    share = f"the description leaves {100.0 * fit.described:.2g} % of the efforts unexplained"
    worst = tuple(loop.joints[j] for j in np.argsort(-fit.shares) if fit.shares[j] > _RIGHT)
    if cause is Cause.WRONG_SIGN:
        wrong = [each for each in fit.changes if each.kind != "order"]
        of = {"axis": "position and effort", "effort": "the effort", "position": "the position"}
        signs = "; ".join(f"{of[each.kind]} of {each.joints[0]}" for each in wrong)
        text = f"the sign is wrong of {signs}: with the other one, {100.0 * fit.restructured:.2g} % remain unexplained"
        return text, "turn the axis in the description, or the sign in the driver", tuple(e.joints[0] for e in wrong)
    if cause is Cause.WRONG_ORDER:
        pairs = [each.joints for each in fit.changes if each.kind == "order"]
        text = f"exchanged: {'; '.join(' and '.join(pair) for pair in pairs)}"
        cure = "correct the names in the driver, or the order in its configuration"
        return text, cure, tuple(joint for pair in pairs for joint in pair)
    if cause is Cause.UNKNOWN_PAYLOAD:
        at = ",".join(f"{round(float(each), 3) + 0.0:g}" for each in fit.center)
        text = f"something of {fit.mass:.2g} kg at the tool explains what {share.removeprefix('the description ')}"
        return text, f"./pidtsm identify-payload BAG --robot {robot}, or --payload {fit.mass:.2g}@{at}", worst
    if cause is Cause.WRONG_GRAVITY:
        text = f"{share}, other masses or centres of mass only {100.0 * fit.bodies:.2g} %"
        return text, f"./pidtsm excite --robot {robot}, and ./pidtsm identify with its bag", worst
    text = f"{share}, and no masses explain more than all but {100.0 * fit.bodies:.2g} %: lengths or axes differ"
    return text, "look for the description of this arm, and ./pidtsm check it", worst


def _plot(fit: ModelFit, loop: Loop) -> Plot:
    """Efforts that remain unexplained, of the worst joints."""
    order = np.argsort(-fit.shares)[:_SHOWN]
    curves = tuple(Curve(loop.joints[j], fit.time, fit.residual[:, j]) for j in order)
    return Plot("Effort that description and friction do not explain", "time [s]", "N m or N", curves)
