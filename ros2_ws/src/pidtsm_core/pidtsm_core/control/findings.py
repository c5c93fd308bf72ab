"""What the controller has found out about its arm, as values and as text.

A finding is stated once it is certain: friction once it exceeds its standard deviation by a share of the effort limit,
the lateness of the drives once they are surely late, roughness once it is more than the drives bear.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.late_drives import Lateness
from pidtsm_core.control.state import ControllerState, Friction, Softness
from pidtsm_core.units import JointUnits
from pidtsm_core.written import number

_WORTH_A_LINE = 0.02
"""Certain friction that is stated, a share of the effort limit."""
_SOFTENED = 0.99
"""Pace below which an arm is called softened."""
_KEY = re.compile(r"found (?P<what>\w+)(?: of (?P<joint>.+?))?(?P<deviation>, deviation)?(?: \((?P<unit>[^()]*)\))?")


class What(str, Enum):
    """What was found."""

    FRICTION = "friction"  # Coulomb friction of a joint beyond ``compensation.coulomb``
    DELAY = "delay"  # of the drives beyond ``drive.delay``, s
    LAG = "lag"  # of the drives beyond ``drive.lag``, s
    LATENESS = "lateness"  # their sum, s
    ROUGHNESS = "roughness"  # of the command of a joint, a share of its limit, see softening.py
    PACE = "pace"  # of law and observer, which were softened, relative to 1


class Finding(NamedTuple):
    """Something that was found."""

    what: What
    joint: str  # empty: of the whole arm
    value: float
    deviation: float | None  # standard deviation; None: not known
    unit: str


def findings(
    config: ControllerConfig, state: ControllerState, joints: Sequence[str], units: Sequence[JointUnits]
) -> tuple[Finding, ...]:
    """Everything that is certain.

    Args:
        config: of the controller.
        state: of the controller.
        joints: names of its joints.
        units: their units.
    """
    return tuple(_found(config, state, joints, units))


def _found(
    config: ControllerConfig, state: ControllerState, joints: Sequence[str], units: Sequence[JointUnits]
) -> Iterator[Finding]:
    known, late, adapts = state.friction, state.lateness, config.adaptation
    if adapts.learns_friction:
        certain = np.abs(known[Friction.COULOMB]) - known[Friction.DEVIATION]
        for j in np.flatnonzero(certain > _WORTH_A_LINE * config.limits.effort).tolist():
            coulomb, deviation = float(known[Friction.COULOMB, j]), float(known[Friction.DEVIATION, j])
            yield Finding(What.FRICTION, joints[j], coulomb, deviation, units[j].effort)
    if adapts.learns_lateness and late[Lateness.LATE]:
        delay, lag = float(late[Lateness.FOUND_DELAY]), float(late[Lateness.FOUND_LAG])
        yield Finding(What.LATENESS, "", delay + lag, float(late[Lateness.DEVIATION]), "s")
        yield Finding(What.DELAY, "", delay, None, "s")
        yield Finding(What.LAG, "", lag, None, "s")
    if adapts.watches_roughness:
        rough, pace = state.softness[Softness.ROUGHNESS], float(state.pace[0])
        if not adapts.softens:
            for j in np.flatnonzero(rough > adapts.roughness).tolist():
                yield Finding(What.ROUGHNESS, joints[j], float(rough[j]), None, "")
        elif 0.0 < pace < _SOFTENED:  # 0 before the first sample.
            yield Finding(What.PACE, "", pace, None, "")


# As text.


class Statement(NamedTuple):
    """A sentence about what was found."""

    what: What
    joint: str  # empty: about the whole arm
    value: float  # a change of which is news
    text: str


def statements(found: Iterable[Finding]) -> list[Statement]:
    """What was found, in sentences without a full stop."""
    by_name = {(each.what, each.joint): each for each in found}
    stated = []
    for (what, joint), each in by_name.items():
        value, text = each.value, ""
        if what is What.FRICTION:
            text = f"{joint}: found {_with_deviation(each)} {each.unit} of friction beyond compensation.coulomb"
        elif what is What.LATENESS:
            text = _lateness(each, [by_name[part, ""] for part in (What.DELAY, What.LAG) if (part, "") in by_name])
        elif what is What.ROUGHNESS:
            share = f"{number(100.0 * value, 2)} % of its limit"
            text = f"{joint}: the command changes by {share} from sample to sample, more than adaptation.roughness"
        elif what is What.PACE:
            left = f"{number(100.0 * value, 2)} % of their bandwidth"
            text = f"commands were rougher than adaptation.roughness; law and observer have {left}"
        if text:
            stated.append(Statement(what, joint, value, text))
    return stated


def _with_deviation(found: Finding, factor: float = 1.0) -> str:
    deviation = "" if found.deviation is None else f" ± {number(factor * found.deviation, 2)}"
    return f"{number(factor * found.value)}{deviation}"


def _lateness(total: Finding, parts: Sequence[Finding]) -> str:
    known = ", ".join(f"{each.what.value} {number(1e3 * each.value, 2)} ms" for each in parts)
    late = f"{_with_deviation(total, 1e3)} ms later than drive.delay and drive.lag"
    return f"the drives are {late}{known and f' ({known})'}"


# As values of metrics.json.


def as_json(found: Finding) -> dict[str, Any]:
    """A finding by the names of its fields."""
    return {**found._asdict(), "what": found.what.value}


def from_json(values: Mapping[str, Any]) -> Finding:
    """The inverse of `as_json`."""
    return Finding(**{**values, "what": What(values["what"])})


# As keys and values of /diagnostics.


def readings(found: Iterable[Finding]) -> list[tuple[str, float, str]]:
    """Names, values and units for a report of the node."""
    rows = []
    for each in found:
        name = f"found {each.what.value}" + (f" of {each.joint}" if each.joint else "")
        rows.append((name, each.value, each.unit))
        if each.deviation is not None:
            rows.append((f"{name}, deviation", each.deviation, each.unit))
    return rows


def from_readings(values: Iterable[tuple[str, str]]) -> tuple[Finding, ...]:
    """What a report of the node has stated; the inverse of `readings`.

    Args:
        values: keys with their units in parentheses, and values, as text; others are passed over.
    """
    found: dict[tuple[What, str], Finding] = {}
    for key, text in values:
        if not (match := _KEY.fullmatch(key)):
            continue
        try:
            what, value = What(match["what"]), float(text)
        except ValueError:
            continue
        name = (what, match["joint"] or "")
        if not match["deviation"]:
            found[name] = Finding(*name, value, None, match["unit"] or "")
        elif name in found:
            found[name] = found[name]._replace(deviation=value)
    return tuple(found.values())
