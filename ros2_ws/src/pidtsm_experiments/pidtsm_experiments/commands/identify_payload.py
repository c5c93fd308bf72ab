"""``./pidtsm identify-payload``: what an arm carries, from a bag of its motion."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from pidtsm_core.errors import UsageError
from pidtsm_core.identification.payload import CarriedBody, as_parameters, identify_payload
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.identify import measurement_of
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.runs.files import writable_file, write_file
from pidtsm_experiments.runs.origin import comment

_EPILOG = """The description should be an identified one, with friction: what it does not explain is taken for the
payload. Ten seconds of a motion of all joints are enough.

example:
  ./pidtsm identify-payload results/carrying/bag --robot results/identified/identified.urdf --out payload.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("bag", type=Path, metavar="BAG", help="bag with joint states, or its file")
    add_arm_arguments(parser, of="the bag")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write a parameter file for the controller")
    parser.add_argument("--json", action="store_true", help="print the payload with its intervals as one JSON object")


def execute(options: argparse.Namespace) -> int:
    definition = read_arm(options)
    if definition is None:
        raise UsageError("--robot: name the file of the identified description")
    place = None if options.out is None else writable_file(options.out)
    arm = definition.described()
    introduce(options)
    with CONSOLE.status("identifying"):
        found = identify_payload(arm, measurement_of(options.bag))
    if place is not None:
        write_file(place, comment() + ros_parameters("controller", as_parameters(found)))
    if options.json:
        arrays = {name: value for name, value in asdict(found).items() if name != "warnings"}
        plain = {name: value if isinstance(value, float) else value.tolist() for name, value in arrays.items()}
        print(json.dumps({**plain, "warnings": list(found.warnings)}, allow_nan=False))
    else:
        _show(found)
    for warning in found.warnings:
        CONSOLE.print(f"pidtsm: warning: {warning}", highlight=False)
    return 0


def _show(found: CarriedBody) -> None:
    """Print the payload with its intervals of 95 %, in the tool frame."""
    out = Console(highlight=False)
    out.print(f"mass            {found.mass:.4g} ± {found.mass_interval:.2g} kg")
    for axis, value, half in zip("xyz", found.center_of_mass, found.center_interval, strict=True):
        out.print(f"centre of mass  {axis} {1e3 * value:.1f} ± {1e3 * half:.1f} mm")
    for name, value, half in zip(
        ("xx", "yy", "zz", "xy", "xz", "yz"), found.inertia, found.inertia_interval, strict=True
    ):
        out.print(f"inertia         {name} {value:.2g} ± {half:.1g} kg m^2")
