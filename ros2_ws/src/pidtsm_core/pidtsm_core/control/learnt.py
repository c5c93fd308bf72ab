"""What a controller has learnt about its arm, in a form that a file can keep: from one activation to the next one.

What is kept is the evidence: the normal equations of the fits of friction_learning.py and lateness_learning.py. All
else follows from it. It counts as little evidence, so that an arm which has changed since is soon learnt anew.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.friction_learning import fit_friction
from pidtsm_core.control.state import ControllerState, Friction
from pidtsm_core.errors import UsageError

_FORM = 2
"""Of the content; other numbers are those of other versions."""
_COUNTS = 0.5
"""s of evidence, as which the kept one counts at most."""
_ABSURD = 1e12
"""In any SI unit: more than anything that is learnt can be."""


class LearntError(UsageError):
    """What a file says that was learnt cannot be used; the message gives the reason."""


def learnt(config: ControllerConfig, state: ControllerState, joints: tuple[str, ...]) -> dict[str, Any]:
    """What has been learnt, as plain dictionaries, lists and numbers.

    Args:
        config: of the controller.
        state: likewise.
        joints: their names.
    """
    kept: dict[str, dict[str, Any]] = {
        group: {name: array.tolist() for name, array in arrays.items()}
        for group, arrays in _arrays(config, state).items()
    }
    content = {"form": _FORM, "joints": list(joints), "beyond": _beyond(config), **kept}
    return {**content, "digest": _digest(content)}


def recall(config: ControllerConfig, state: ControllerState, joints: tuple[str, ...], content: Any) -> None:
    """Go on from what was learnt before; the controller must have been reset. Nothing changes if it is refused.

    Args:
        config: of the controller.
        state: likewise; what is learnt changes.
        joints: their names.
        content: what `learnt` has returned.

    Raises:
        LearntError: it is something else, of other joints, beyond other parameters, or has absurd numbers.
    """
    if (
        not isinstance(content, Mapping)
        or content.get("form") != _FORM
        or not isinstance(content.get("beyond"), Mapping)
    ):
        raise LearntError("it is not of the form that this version writes")
    if content.get("digest") != _digest({name: value for name, value in content.items() if name != "digest"}):
        raise LearntError("it was damaged or edited")
    if content.get("joints") != list(joints):
        raise LearntError(f"it is about the joints {content.get('joints')}, not {list(joints)}")
    for name, value in _beyond(config).items():
        if (before := content["beyond"].get(name)) != value:
            raise LearntError(f"it was learnt with {name} {before}, which is now {value}")
    read = {
        group: {name: _read(content, group, name, array.shape) for name, array in arrays.items()}
        for group, arrays in _arrays(config, state).items()
    }
    for group, arrays in _arrays(config, state).items():
        found = read[group]
        share = np.minimum(_COUNTS / np.maximum(found["evidence"], _COUNTS), 1.0)
        for name, array in arrays.items():
            of_joints = found[name].reshape(share.size, -1)
            array[:] = (share[:, np.newaxis] * of_joints).reshape(array.shape)
    if config.adaptation.learns_friction:
        for j in np.flatnonzero(state.friction[Friction.EVIDENCE] > 0.0).tolist():
            fit_friction(config, state, j)


def _digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of a content: evidence that nothing has shown would make an arm run away."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _read(content: Mapping[str, Any], group: str, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An array of the content.

    Raises:
        LearntError: it is missing, has another shape, or a number that is absurd.
    """
    try:
        values = np.array(content[group][name], dtype=np.float64)
    except (KeyError, OverflowError, TypeError, ValueError):
        raise LearntError(f"{group}.{name} is missing, or has something else than numbers") from None
    if values.shape != shape:
        raise LearntError(f"{group}.{name} has the shape {values.shape} instead of {shape}")
    if not (np.abs(values) < _ABSURD).all():
        raise LearntError(f"{group}.{name} has absurd numbers")
    return values


def _arrays(config: ControllerConfig, state: ControllerState) -> dict[str, dict[str, Array]]:
    """The evidence by group and name; the first axis of each array is that of the joints; proportional to time."""
    groups, bank = {}, state.bank
    if config.adaptation.learns_friction:
        groups["friction"] = {
            "normal": state.friction_evidence,
            "squares": state.friction[Friction.SQUARES],
            "slow": state.friction[Friction.SLOW],
            "forth": state.friction[Friction.FORTH],
            "back": state.friction[Friction.BACK],
            "evidence": state.friction[Friction.EVIDENCE],
        }
    if config.adaptation.learns_lateness:
        groups["lateness"] = {name: getattr(bank, name) for name in ("normal", "mixed", "squares", "evidence")}
    return groups


def _beyond(config: ControllerConfig) -> dict[str, Any]:
    """The parameters beyond which friction and lateness are found."""
    compensation = {f"compensation.{name}": value.tolist() for name, value in config.compensation._asdict().items()}
    return {**compensation, "drive.delay": config.drive.delay, "drive.lag": config.drive.lag.tolist()}
