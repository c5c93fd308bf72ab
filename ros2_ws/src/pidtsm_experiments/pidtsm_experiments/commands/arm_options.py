"""The options that define the arm, the same for every command that takes ``--robot``."""

import argparse
import math
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.default_motion import largest_holding_effort
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import NAMES, TreeRobot
from pidtsm_core.robots.definition import ArmDefinition, check_name, file_content, find_arm, joints_sentence
from pidtsm_core.robots.stored import arms_folder, stored_file
from pidtsm_experiments.runs.files import writable_file, write_file

_ABOUT = "choose the arm; --save stores the choice under a name for --robot"
_HARDLY = 0.9
"""Share of its effort limit above which a joint can hardly carry the arm."""
_OPTIONS = ("joints", "lock", "effort", "payload", "xacro", "save")
"""All but ``--robot``."""


def add_arm_arguments(
    parser: argparse.ArgumentParser,
    several: bool = False,
    of: str = "simulator and controller",
    positional: bool = False,
) -> None:
    """Add the options that define the arm.

    Args:
        parser: of the command.
        several: whether ``--robot`` can be repeated.
        of: what uses the arm.
        positional: whether the command cannot do without an arm, so that ``--robot`` is left out.
    """
    folder = _shown(arms_folder()).replace("%", "%%")
    group = parser.add_argument_group("arm", _ABOUT)
    text = f"the arm of {of}: one of {', '.join(NAMES)}, a name given to --save, or a URDF, xacro or MJCF file"
    if positional:
        group.add_argument("robot", metavar="ROBOT", help=text)
    elif several:
        group.add_argument("--robot", action="append", default=[], metavar="NAME|FILE", help=f"{text}; can be repeated")
    else:
        group.add_argument("--robot", metavar="NAME|FILE", help=text)
    group.add_argument(
        "--joints",
        type=_joints,
        metavar="A,B,C",
        help="joints that move, in this order (default: the chain from the base, without a gripper)",
    )
    group.add_argument(
        "--lock",
        type=_locked,
        action="append",
        metavar="JOINT=Q",
        help="position of a joint that does not move, rad or m (default: 0, or the limit next to it); can be repeated",
    )
    group.add_argument(
        "--effort",
        type=_effort,
        metavar="E,E,E|JOINT=E",
        help="effort limits, N m or N: one for all joints, one for each, or those that differ from the description, "
        "such as elbow=40,wrist=10",
    )
    group.add_argument(
        "--payload",
        type=_payload,
        metavar="KG[@X,Y,Z]",
        help="what the arm carries and the controller knows: mass, and centre of mass in the frame of the tool, m, "
        "such as 1.5@0,0,0.1",
    )
    group.add_argument(
        "--xacro",
        type=_argument,
        action="append",
        metavar="NAME:=VALUE",
        help="argument of a xacro file, such as mass:=5; can be repeated",
    )
    group.add_argument("--save", type=_name, metavar="NAME", help=f"store the arm, in {folder}")


def read_arm(options: argparse.Namespace) -> ArmDefinition | None:
    """The arm that the options of `add_arm_arguments` define, with its joints named; None: they define none.

    Raises:
        UsageError: an option needs ``--robot``, or the arm cannot have what is specified.
    """
    given = given_arm(options)
    # What decides on the joints may follow: an override of a parameter.
    with suppress(ParameterError):
        return given and given.with_joints()
    return given


def introduce(options: argparse.Namespace) -> None:
    """Print which joints of a file are used, on standard error, and store the arm if ``--save`` is given.

    To be called after all other input has been checked.

    Raises:
        UsageError: see `read_arm`; with ``--save``, also if the arm or its place cannot be used.
    """
    arm = given_arm(options)
    for each in [find_arm(robot) for robot in _robots(options)] if arm is None else [arm]:
        if each.is_file and not each.name:
            with suppress(ParameterError):
                robot = each.robot()
                assert isinstance(robot, TreeRobot)
                _note(f"{Path(each.label).name}: {joints_sentence(robot.description)}")
                _warn_of_weakness(each)
    if options.save is not None and arm is not None:
        _store(options.save, arm.with_joints())


def _warn_of_weakness(arm: ArmDefinition) -> None:
    """Name the joints that can hardly carry the arm about the middle of its range, where it moves by default."""
    robot = arm.robot()
    needed = largest_holding_effort(robot, arm.described().tree.copy())
    limits = np.array(arm.settings().get("limits.effort", robot.effort_limit))
    weak = np.flatnonzero(needed > _HARDLY * limits)
    if weak.size == 0:
        return
    shares = ", ".join(f"{robot.joints[j]} {needed[j]:.3g} of {limits[j]:.3g} {robot.units[j].effort}" for j in weak)
    cure = ",".join(f"{robot.joints[j]}={2.0 * needed[j]:.2g}" for j in weak)
    _note(
        f"warning: to carry the arm about the middle of its range takes {shares}; move where it takes less, or if "
        f"the drives can do more, give --effort {cure}"
    )


def settings_of(arm: ArmDefinition | None) -> Mapping[str, Any]:
    """Parameters of a controller for the arm; none: those of the default arm."""
    return {} if arm is None else arm.settings()


def given_arm(options: argparse.Namespace) -> ArmDefinition | None:
    """The arm exactly as the options define it; None: none is given.

    Raises:
        UsageError: an option needs ``--robot``, or contradicts another one.
    """
    given = [name for name in _OPTIONS if getattr(options, name) is not None]
    robots = _robots(options)
    if not robots:
        if given:
            raise UsageError(f"--{given[0]} needs --robot")
        return None
    if len(robots) > 1:
        if given:
            raise UsageError(
                f"--{given[0]} is for one arm, and --robot names {len(robots)}; store each one with --save first"
            )
        return None
    arm = find_arm(robots[0])
    changes = _changes(options, arm)
    return replace(arm, **changes, name="") if changes else arm


def _robots(options: argparse.Namespace) -> list[str]:
    """What ``--robot`` names."""
    return [options.robot] if isinstance(options.robot, str) else options.robot or []


def _changes(options: argparse.Namespace, arm: ArmDefinition) -> dict[str, Any]:
    """What the options specify about an arm, by field."""
    changes: dict[str, Any] = {}
    locked = dict(pair for pairs in options.lock or () for pair in pairs)
    if options.joints is not None:
        changes["joints"] = options.joints
    if both := [joint for joint in options.joints or () if joint in locked]:
        raise UsageError(f"--joints and --lock both name {both[0]}; a joint moves or is locked")
    if locked:
        before = changes.get("joints", arm.joints)
        changes["joints"] = tuple(joint for joint in before if joint not in locked)
        if before and not changes["joints"]:
            raise UsageError(f"--lock leaves no joint that moves; of {', '.join(before)}, one must")
    if options.joints is not None or locked:
        kept = {name: q for name, q in arm.locked.items() if name not in (options.joints or ())}
        changes["locked"] = {**kept, **locked}
    if options.effort is not None:
        changes["effort"] = options.effort
    if options.payload is not None:
        changes["payload"], changes["center_of_mass"] = options.payload
    if options.xacro:
        changes["xacro"] = {**arm.xacro, **dict(options.xacro)}
    return changes


def _store(name: str, arm: ArmDefinition) -> None:
    """Write the file of an arm that can be used.

    Raises:
        UsageError: it cannot be used, or its file cannot be written.
    """
    arm.robot()
    file = stored_file(name)
    known = file.exists()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--save {name}: {error.filename}: {error.strerror}") from None
    write_file(writable_file(file), file_content(arm))
    _note(f"{name}: {'replaced' if known else 'stored'} in {_shown(file)}; --robot {name} uses it")


def _note(text: str) -> None:
    print(f"pidtsm: {text}", file=sys.stderr)


def _shown(path: Path) -> str:
    """A path, with ~ for the home of the user."""
    with suppress(ValueError, RuntimeError):
        return f"~/{path.relative_to(Path.home())}"
    return str(path)


def _joints(text: str) -> tuple[str, ...]:
    names = tuple(text.replace(",", " ").split())
    if not names:
        raise argparse.ArgumentTypeError(f"{text!r} names no joint; it must be of the form a,b,c")
    return names


def _locked(text: str) -> list[tuple[str, float]]:
    pairs = [word.partition("=") for word in text.replace(",", " ").split()]
    if not pairs or not all(name and value for name, _, value in pairs):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form JOINT=POSITION, such as finger=0.02")
    return [(name, _number(value)) for name, _, value in pairs]


def _effort(text: str) -> tuple[float, ...] | dict[str, float]:
    words = text.replace(",", " ").split()
    named = [word for word in words if "=" in word]
    if not words or len(named) not in (0, len(words)):
        raise argparse.ArgumentTypeError(f"{text!r} is neither of the form 80,40 nor of the form JOINT=80,JOINT=40")
    if named:
        return {name: _positive(value) for name, _, value in (word.partition("=") for word in words)}
    return tuple(_positive(word) for word in words)


def _payload(text: str) -> tuple[float, tuple[float, ...]]:
    mass, at, center = text.partition("@")
    place = [_number(word) for word in center.replace(",", " ").split()] if at else [0.0, 0.0, 0.0]
    if len(place) != 3 or _number(mass) < 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form KG or KG@X,Y,Z, such as 1.5@0,0,0.1")
    return _number(mass), tuple(place)


def _argument(text: str) -> tuple[str, str]:
    name, separator, value = text.partition(":=")
    if not name or not separator:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME:=VALUE, such as mass:=5")
    return name, value


def _name(text: str) -> str:
    try:
        check_name(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def _number(text: str) -> float:
    with suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")


def _positive(text: str) -> float:
    if (value := _number(text)) > 0.0:
        return value
    raise argparse.ArgumentTypeError(f"{text!r} must be above zero")
