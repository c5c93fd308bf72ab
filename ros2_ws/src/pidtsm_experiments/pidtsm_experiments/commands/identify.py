"""``./pidtsm identify``: a corrected description of an arm, from bags of its motions."""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.identification.identification import Identification, identify
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.identification.written import corrected_description, judged_as_written, written_parameters
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.files import load_ros_parameters, ros_parameters
from pidtsm_core.robots import DESCRIPTION, LOCKED
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.robots.payload import MASS
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import result_folder

_EPILOG = """The bags have joint states with positions and torques, of this project or of another controller. The last
fifth of each is not fitted, but judges the result. With --payload, the arm carried that: the result is the arm with it.
docs/identify.md walks from an unknown arm to a tuned controller.

examples:
  ./pidtsm excite --robot panda --out panda.yaml
  ./pidtsm run --scenario panda.yaml --params practical --clock lockstep --out results/panda
  ./pidtsm identify results/panda/bag --robot panda --out results/identified
  ./pidtsm gains --robot results/identified/identified.urdf
"""
URDF, MJCF, PARAMETERS = "identified.urdf", "identified.xml", "identified.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="bag with joint states, or its file")
    add_arm_arguments(parser, of="the bags")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results/identified"),
        metavar="DIR",
        help=f"result folder: {URDF} (of an MJCF: {MJCF}), {PARAMETERS}, identification.html, identification.json "
        "(default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")


def execute(options: argparse.Namespace) -> int:
    from pidtsm_studies.identification.report import write_identification_report
    from pidtsm_studies.identification.results import as_json

    definition = read_arm(options)
    if definition is None:
        raise UsageError("--robot: name the arm of the bags, or the file of its description")
    arm = definition.described()
    file = URDF if arm.is_urdf else MJCF
    introduce(options)
    measurements = [measurement_of(bag) for bag in options.bags]
    with CONSOLE.status("identifying"):
        found = identify(arm, measurements, options.robot)
    with result_folder(options.out, MadeOf(runs=tuple(options.bags))) as folder:
        (folder / file).write_text(corrected_description(arm, found.parameters), encoding="utf-8")
        written = written_parameters(found, str(options.out.absolute() / file))
        more = _kept_of(definition)
        text = "".join(ros_parameters(node, {**values, **more}) for node, values in written.items())
        (folder / PARAMETERS).write_text(text, encoding="utf-8")
        found = _read_back(found, folder, file)
        result = as_json(found)
        (folder / "identification.json").write_text(json.dumps(result, allow_nan=False) + "\n", encoding="utf-8")
        page = folder / "identification.html"
        write_identification_report(page, found, _short(definition.label), definition.description)
    if options.json:
        print(json.dumps(result, allow_nan=False))
    else:
        for table in _tables(result):
            Console().print(table)
    for note in found.notes:
        CONSOLE.print(f"pidtsm: note: {note}", highlight=False, soft_wrap=True)
    for warning in found.warnings:
        CONSOLE.print(f"pidtsm: warning: {warning}", highlight=False, soft_wrap=True)
    CONSOLE.print(f"{options.out}: {file} {PARAMETERS} identification.html identification.json", highlight=False)
    return 0


def measurement_of(bag: Path) -> Measurement:
    """See `read_measurement`; what was used of the bag is printed on standard error.

    Raises:
        UsageError: the bag cannot be used.
    """
    from pidtsm_experiments.bags.errors import RecordingError
    from pidtsm_experiments.bags.measurements import read_measurement

    try:
        measurement, source = read_measurement(bag)
    except RecordingError as error:
        raise UsageError(str(error)) from None
    CONSOLE.print(f"{bag}: truth: {source}", highlight=False, soft_wrap=True)
    return measurement


def _short(label: str) -> str:
    """Name of an arm, or the file of its description with its folder: many files are named identified.urdf."""
    path = Path(label)
    return str(Path(path.parent.name, path.name))


def _kept_of(arm: ArmDefinition) -> dict[str, Value]:
    """What the options specify about the arm and still holds for the identified one; its payload is a part of that."""
    kept = {name: value for name, value in arm.settings().items() if name in (LOCKED.name, "limits.effort")}
    return {**kept, **({MASS: 0.0} if arm.payload else {})}


def _read_back(found: Identification, folder: Path, file: str) -> Identification:
    """The result, judged by the files in the folder; the parameters name the description where it will be."""
    settings = load_ros_parameters(folder / PARAMETERS)["controller"]
    description = (folder / file).read_text(encoding="utf-8")
    return judged_as_written(found, {**settings, DESCRIPTION.name: description})


def _tables(result: dict[str, Any]) -> Iterator[Table]:
    """Errors of the torque, and friction; each as wide as names of joints of 20 letters need in 80 columns."""
    kinds = {"error before": "before", "error after": "after", "as written": "as_written"}
    errors = {title: result["torque_error"][kind] for title, kind in kinds.items()}
    friction = {name: result[name.lower()] for name in ("Coulomb", "viscous", "armature", "offset")}
    for title, columns in (("torque on data kept apart", errors), ("friction and armature", friction)):
        table = Table(title=title, title_style="bold", box=box.SIMPLE_HEAD)
        table.add_column("joint", overflow="fold")
        for column in columns:
            table.add_column(column, justify="right")
        for joint, *values in zip(result["joints"], *columns.values(), strict=True):
            table.add_row(escape(joint), *(f"{value:.3g}" for value in values))
        yield table
