"""``./pidtsm excite``: a motion that shows the parameters of an arm."""

import argparse
import os
from copy import deepcopy
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.identification.excitation import Excitation, excitation
from pidtsm_core.parameters.files import load_mapping
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import CONSOLE, add_parameter_arguments, seconds
from pidtsm_experiments.runs.files import writable_file, write_file
from pidtsm_experiments.runs.origin import comment

_EPILOG = """The motion is a Fourier series within the limits of position, velocity, acceleration and torque of the arm.
It knows nothing of collisions: set position limits within which the arm hits neither itself nor anything else, and
look at it in a simulation first. On a real arm, the node trajectory takes the CSV file as reference.file.

examples:
  ./pidtsm excite --robot panda --out panda.yaml --set trajectory.limits.velocity=0.8
  ./pidtsm run --scenario panda.yaml --clock lockstep --out results/panda
  ./pidtsm identify results/panda/bag --robot panda
"""
_ABOUT = "a motion that shows inertias and friction, for ./pidtsm identify"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    add_arm_arguments(parser, of="the motion")
    parser.add_argument("--duration", type=seconds, default=60.0, metavar="S", help="duration (default: %(default)g)")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.yaml", help="scenario; FILE.csv beside it is the motion"
    )
    add_parameter_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    definition = read_arm(options)
    if definition is None:
        raise UsageError("--robot: name the arm, or the file of its description")
    if options.out.suffix != ".yaml":
        raise UsageError(f"--out {options.out}: its name must end with .yaml")
    scenario, motion = _places(options.out)
    given = make_experiment(None, params=options.params, overrides=options.set, robot=definition)
    of_arm, arm = definition.settings(), definition.described()
    limited = {name: value for name, value in given.settings["trajectory"].items() if name.startswith("limits.")}
    limits = motion_limits({**of_arm, **limited, "joints": list(arm.joints)})
    if limits.joints != arm.joints:
        raise UsageError(f"joints: the limits are of {', '.join(limits.joints)}, the arm has {', '.join(arm.joints)}")
    introduce(options)
    with CONSOLE.status("optimising the motion"):
        found = excitation(arm, limits, options.duration)
    write_file(motion, _table(found))
    write_file(scenario, comment() + yaml.safe_dump(_scenario(found, motion, of_arm), sort_keys=False))
    CONSOLE.print(
        f"{options.out} {options.out.with_suffix('.csv')}: {found.time[-1]:.0f} s, condition number "
        f"{found.condition:.1f}",
        highlight=False,
    )
    return 0


def _places(out: Path) -> tuple[Path, Path]:
    """The files of the scenario and of the motion.

    Raises:
        UsageError: one of them cannot be written, or the second, which the user has not named, is not of a motion that
            this command has made.
    """
    scenario = writable_file(out)
    motion = scenario.with_suffix(".csv")
    if os.path.lexists(motion) and _motion_of(scenario) != str(motion):
        raise UsageError(f"--out {out}: {motion} is not of {scenario.name}; move it away, or name another file")
    return scenario, writable_file(motion)


def _motion_of(scenario: Path) -> str | None:
    """The file of the motion that a scenario names, if it is one of this command; otherwise None."""
    try:
        content = load_mapping(scenario)
        return str(content["trajectory"]["reference"]["file"]) if content["description"] == _ABOUT else None
    except (UsageError, KeyError, TypeError):
        return None


def _table(found: Excitation) -> str:
    """Time, q, q' and q'' as the reference ``csv`` reads them."""
    columns = [f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in found.joints]
    text, header = StringIO(), ",".join(["time", *columns])
    np.savetxt(
        text, np.column_stack([found.time, *found.motion]), fmt="%.9g", delimiter=",", header=header, comments=""
    )
    return text.getvalue()


def _scenario(found: Excitation, motion: Path, of_arm: dict[str, Any]) -> dict[str, Any]:
    """A scenario with the motion as its reference."""
    return {
        "description": _ABOUT,
        "duration": float(found.time[-1]),
        "simulator": {**of_arm, "initial_position": found.motion[0, 0].tolist()},
        "controller": deepcopy(of_arm),  # A list that is there twice would be an alias in YAML.
        "trajectory": {"joints": list(found.joints), "reference": {"name": "csv", "file": str(motion)}},
    }
