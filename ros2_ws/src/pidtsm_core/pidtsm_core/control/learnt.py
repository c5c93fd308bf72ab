"""What a controller has learnt about its arm, in a form that a file can keep: from one activation to the next one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, Friction
from pidtsm_core.errors import UsageError

_FORM = 1
"""Of the content; other numbers are those of other versions."""
_USED = (Friction.USED, Friction.EFFORT, Friction.MIDDLE_SHARE, Friction.SOFT_SHARE)
"""Rows that are not kept: what is used grows slowly from zero."""


class LearntError(UsageError):
    """What a file says that was learnt cannot be used; the message gives the reason."""


def learnt(config: ControllerConfig, state: ControllerState, joints: tuple[str, ...]) -> dict[str, Any]:
    """What has been learnt, as plain dictionaries, lists and numbers.

    Args:
        config: of the controller.
        state: likewise.
        joints: their names.
    """
    kept = {group: {name: array.tolist() for name, array in arrays.items()} for group, arrays in _arrays(config, state)}
    return {"form": _FORM, "joints": list(joints), "beyond": _beyond(config), **kept}


def recall(config: ControllerConfig, state: ControllerState, joints: tuple[str, ...], content: Any) -> None:
    """Go on from what was learnt before; the controller must have been reset. Nothing changes if it is refused.

    Args:
        config: of the controller.
        state: likewise; what is learnt changes.
        joints: their names.
        content: what `learnt` has returned.

    Raises:
        LearntError: it is something else, of other joints, beyond other parameters, or has numbers that are not finite.
    """
    if not isinstance(content, Mapping) or content.get("form") != _FORM:
        raise LearntError("it is not of the form that this version writes")
    if content.get("joints") != list(joints):
        raise LearntError(f"it is about the joints {content.get('joints')}, not {list(joints)}")
    for name, value in _beyond(config).items():
        if (before := content.get("beyond", {}).get(name)) != value:
            raise LearntError(f"it was learnt beyond {name} {before}; now it is {value}")
    found = []
    for group, arrays in _arrays(config, state):
        for name, array in arrays.items():
            found.append((array, _read(content, group, name, array.shape)))
    for array, values in found:
        array[:] = values
    state.friction[list(_USED)] = 0.0


def _read(content: Mapping[str, Any], group: str, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An array of the content.

    Raises:
        LearntError: it is missing, has another shape, or a number that is not finite.
    """
    try:
        values = np.array(content[group][name], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        raise LearntError(f"{group}.{name} is missing, or has something else than numbers") from None
    if values.shape != shape or not np.isfinite(values).all():
        raise LearntError(f"{group}.{name} has the shape {values.shape} instead of {shape}, or is not finite")
    return values


def _arrays(config: ControllerConfig, state: ControllerState) -> list[tuple[str, dict[str, NDArray[np.float64]]]]:
    """The arrays that contain what is learnt, of any shape, by group and name."""
    bank, groups = state.bank, []
    if config.adaptation.learns_friction:
        friction = {"found": state.friction, "evidence": state.friction_evidence, "fit": state.friction_fit}
        groups.append(("friction", friction))
    if config.adaptation.learns_lateness:
        hypotheses = {name: getattr(bank, name) for name in ("normal", "mixed", "squares", "evidence", "left")}
        groups.append(("lateness", {"found": state.lateness, **hypotheses}))
    return groups


def _beyond(config: ControllerConfig) -> dict[str, Any]:
    """The parameters beyond which friction and lateness are found."""
    compensation = {f"compensation.{name}": value.tolist() for name, value in config.compensation._asdict().items()}
    return {**compensation, "drive.delay": config.drive.delay, "drive.lag": config.drive.lag.tolist()}
