"""Step 7: a motion that shows inertias and friction, and the description that explains its torques."""

from typing import Any

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.identification.excitation import excitation
from pidtsm_core.identification.identification import Identification, IdentificationError, identify
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.identification.regressor import OF_JOINT
from pidtsm_core.identification.written import corrected_description, written_parameters
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.robots.payload import MASS
from pidtsm_core.robots.tree.unit_forces import LINK
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.motions import STEP, Motion

DURATION = 40.0
"""s of the motion."""
_ABOUT = {"coulomb": "Coulomb friction", "viscous": "viscous friction", "offset": "constant torque"}
_LOOSE = 0.6
"""rad; tracking error at which the arm is stopped: a model that is still wrong, and joints that stick, follow badly."""
_LIGHTEST = 0.33
"""Share of the described inertia of a joint below which an identified one is not believed."""
_REACH, _QUICK, _GENTLE = 1.0, 1.2, 4.0
"""rad, rad/s and rad/s^2: bounds of the motion."""


def _motion(bench: Bench) -> Motion:
    model = bench.model(identified=False)
    reach = bench.reach(model, _REACH)
    limits = motion_limits(
        {
            **{
                name: value for name, value in bench.arm.items() if name.startswith("robot.") or name == "limits.effort"
            },
            "joints": list(model.joints),
            "limits.min_position": (bench.home - reach).tolist(),
            "limits.max_position": (bench.home + reach).tolist(),
            "limits.velocity": np.minimum(_QUICK, model.velocity).tolist(),
            "limits.acceleration": _GENTLE,
        }
    )
    found = excitation(bench.described(), limits, DURATION)
    time = np.arange(0.0, found.time[-1], STEP)
    states = np.stack([np.stack([np.interp(time, found.time, c) for c in each.T], axis=1) for each in found.motion])
    states[1:, [0, -1]] = 0.0
    return Motion(states)


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    model = bench.model(identified=False)
    reach = bench.reach(model, _REACH)
    text = f"All joints swing for {DURATION:.0f} s, within {_REACH:g} rad of here, at up to {_QUICK:g} rad/s."
    return Plan(text, reach, model.effort, DURATION)


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    try:
        bench.described()
    except UsageError as error:
        return Outcome("the description stays: it has no bodies to correct", {}, [str(error)])
    samples = bench.follow(_motion(bench), velocity=_QUICK, error=_LOOSE, again=_LOOSE)
    moved, model = samples.motion, bench.model(identified=False)
    measurement = Measurement(
        model.joints, moved.time, moved.position, moved.effort, np.full(len(model.joints), np.inf)
    )
    try:
        found = identify(bench.described(), [measurement], "ROBOT", bench.swung)
    except IdentificationError as error:
        reasons = str(error).splitlines()
        return Outcome("the description stays: nothing was identified", {}, reasons, samples={"identify": samples})
    figures = {**_figures(found), "parameters": _parameters(found)}
    before, after = (np.array(figures[name]) for name in ("before", "after"))
    share = after / np.maximum(before, 1e-9)
    left = (
        f"the identified model leaves {100.0 * float(np.median(share)):.0f} % of the error of the description's torques"
    )
    kept = {"identify": samples}
    if light := implausibly_light(bench, figures["parameters"]):
        del figures["parameters"]
        problem = f"{light}: what sticks hides inertias, and a controller that takes a joint for so light is dangerous"
        return Outcome("the description stays", figures, [*found.warnings, problem], samples=kept)
    if np.median(share) >= 1.0:  # The description is as good as what was measured.
        del figures["parameters"]
        return Outcome(f"the description stays: {left}", figures, found.warnings, samples=kept)
    friction = {name: value for name, value in figures["parameters"].items() if name.startswith("compensation.")}
    parameters = {}
    for name, value in friction.items():
        of = name.partition(".")[2]
        half = ", ".join("?" if each is None else f"{each:.2g}" for each in figures["half_interval"][of])
        parameters[name] = (value, f"identified {_ABOUT[of]}, ± {half} (95 %; ?: the motion does not show it)")
    return Outcome(left, figures, found.warnings, parameters, kept)


def implausibly_light(bench: Bench, parameters: dict[str, Any]) -> str:
    """Which joints an identified arm takes for much lighter than they are described, as text; empty: none.

    Args:
        bench: with the arm as it is described.
        parameters: those of the controller that choose the identified arm.
    """
    described, identified = (np.diag(ArmModel({**bench.arm, **each}).inertia(bench.home)) for each in ({}, parameters))
    share, joints = identified / described, bench.model(identified=False).joints
    return ", ".join(
        f"{joints[j]} is identified as {share[j]:.2g} times as heavy as described"
        for j in np.flatnonzero(share < _LIGHTEST)
    )


def _parameters(found: Identification) -> dict[str, Any]:
    """Parameters of the controller of the identified arm, with the text of its description."""
    text = corrected_description(found.arm, found.parameters)
    values = written_parameters(found, text)["controller"]
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    # What the user had told of a payload is a part of the identified bodies.
    return {**plain, DESCRIPTION.name: text, MASS: 0.0}


def _half_intervals(found: Identification) -> dict[str, list[float | None]]:
    """Half of the interval of 95 % of each parameter of the joints, by name; None: the motion does not show it."""
    joints = len(found.arm.joints)
    known = dict(zip(found.base.columns.tolist(), found.fit.half_interval.tolist(), strict=True))
    for hidden in found.undetermined:
        known.pop(int(found.base.columns[hidden]))
    return {name: [known.get(LINK * joints + k * joints + j) for j in range(joints)] for k, name in enumerate(OF_JOINT)}


def _sure_bodies(found: Identification) -> str:
    """How sure the identified combinations of masses, centres and inertias are, in words."""
    of_links = found.base.columns < LINK * len(found.arm.joints)
    shown = of_links & ~np.isin(np.arange(of_links.size), found.undetermined)
    if not shown.any():
        return "the motion shows none of its combinations of masses"
    share = found.fit.half_interval[shown] / np.maximum(np.abs(found.fit.beta[shown]), 1e-9)
    return (
        f"the motion shows {np.count_nonzero(shown)} of {np.count_nonzero(of_links)} combinations of masses, half of "
        f"them within ± {100.0 * float(np.median(share)):.2g} % (95 %)"
    )


def _figures(found: Identification) -> dict[str, Any]:
    check = found.check
    return {
        "half_interval": _half_intervals(found),
        "bodies": _sure_bodies(found),
        "before": check.error(check.before).tolist(),
        "after": check.error(check.after).tolist(),
        "condition": found.fit.condition,
        "delay": found.fit.delay,
        "delay_deviation": found.fit.delay_deviation,
        "notes": list(found.notes),
    }
