"""What is wrong with the model: signs, order, another arm, masses, or a payload; one estimate tells them apart.

The description leaves a part of the effort unexplained. Of all that may be wrong, what explains most of it with the
fewest numbers is the cause: another sign or order needs none, a payload four, masses and centres the base parameters of
the arm. Lengths and axes are in no number: if even free masses leave much, it is the description of another arm.
"""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.robots import Description
from pidtsm_core.written import number
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.model_fit import ModelFit, TooLittleMotionError, fit_models
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict, unknown

_RIGHT, _RIGHT_WORST = 0.037, 0.08
"""Shares of the efforts, of all joints and of the worst, that no description explains: cogging, and masses that
are some percent off."""
_DISTURBED = 2.5
"""Factor of both where the reference jitters: fast motion shows friction and gears that no model has."""
_STRUCTURE = 0.35
"""Share of the unexplained effort that may remain with the right signs and order."""
_PAYLOAD, _PAYLOAD_OF_SCALED = 0.4, 0.8
"""Shares that may remain with a payload: of what the description leaves, and of what a factor of all masses leaves."""
_AS_GOOD, _NOISE = 1.8, 0.006
"""A payload that leaves at most so many times what free masses leave, plus so much, is the simpler reason."""
_LIGHTEST = 0.05
"""kg."""
_BODIES, _OF_DESCRIBED = 0.021, 0.1
"""Share that the right geometry with free masses leaves, also relative to what the description leaves."""
_EXPLAINED, _ANOTHER = 0.5, 0.12
"""Where the reference jitters, another arm is certain if free masses explain a part at least, or if so much is
unexplained."""
CAUSES = (Cause.WRONG_SIGN, Cause.WRONG_ORDER, Cause.OTHER_ARM, Cause.WRONG_GRAVITY, Cause.UNKNOWN_PAYLOAD)
"""Of these verdicts, in their order."""
_NO_ARM = "the arm is not known; name it with --robot"
_SHOWN = 3
"""Joints of the plot."""


def model_verdicts(loop: Loop, arm: Description | None, robot: str, disturbed: bool) -> list[Verdict]:
    """Verdicts on `CAUSES`.

    Args:
        loop: the recording; if there is an arm, with its joints in its order.
        arm: what the controller believes; None: it is not known.
        robot: what ``--robot`` names it, for cures.
        disturbed: whether the reference jitters.
    """
    if arm is None:
        return [unknown(cause, _NO_ARM) for cause in CAUSES]
    try:
        fit = fit_models(arm, loop)
    except TooLittleMotionError as error:
        return [unknown(cause, str(error)) for cause in CAUSES]
    found = _cause(fit, _DISTURBED if disturbed else 1.0)
    return [_verdict(cause, fit, loop, robot) if cause in found else _fine(cause, fit) for cause in CAUSES]


def _cause(fit: ModelFit, patience: float) -> Sequence[Cause]:
    """What is wrong with the model; empty: nothing. `patience`: factor of the shares that no description explains."""
    if fit.described < patience * _RIGHT and fit.worst < patience * _RIGHT_WORST:
        return ()
    # With the right signs and order, the description is as good as any.
    if fit.changes and fit.restructured < max(_STRUCTURE * fit.described, patience * _RIGHT):
        kinds = dict.fromkeys(Cause.WRONG_ORDER if each.kind == "order" else Cause.WRONG_SIGN for each in fit.changes)
        return tuple(kinds)
    left = min(fit.payload, fit.bodies)
    is_simplest = fit.payload < min(_PAYLOAD * fit.described, _PAYLOAD_OF_SCALED * fit.scaled)
    if fit.mass > _LIGHTEST and is_simplest and fit.payload < _AS_GOOD * fit.bodies + _NOISE:
        return (Cause.UNKNOWN_PAYLOAD,)
    if fit.bodies < max(patience * _BODIES, _OF_DESCRIBED * fit.described):
        return (Cause.WRONG_GRAVITY,)
    certain = patience == 1.0 or left < _EXPLAINED * fit.described or fit.described > _ANOTHER
    return (Cause.OTHER_ARM,) if certain else ()


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
        at = ",".join(number(float(each), 2) for each in fit.center)
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
