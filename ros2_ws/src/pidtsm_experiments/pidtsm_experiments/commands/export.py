"""``./pidtsm export``: a run or a bag for other programs, as a table or to be played."""

import argparse
import csv
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from pidtsm_core.errors import UsageError, how_to_install
from pidtsm_core.recording import Recording
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.tables import Table, message_table, sample_table
from pidtsm_experiments.commands.export_demonstrations import (
    add_demonstration_arguments,
    refuse_demonstration_options,
    write_demonstrations,
)
from pidtsm_experiments.commands.export_played import add_played_arguments, played_formats, write_played
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.files import writable_file, write_file
from pidtsm_experiments.runs.origin import origin_of
from pidtsm_experiments.runs.saved import bag_of

_EPILOG = """Tables. A run has one row per sample: time (s); position, velocity, error, effort, reference and signals of
the controller for each joint, in columns such as effort.joint2.

Any other bag, and any with --messages, has one row for each joint of each message whose type has joint names, such as
sensor_msgs/JointState: topic, time (s, since the earliest stamp), stamp (ns), joint, and the fields of the messages,
such as position; cells are empty where a message lacks a field.

Units are those of the messages: rad, rad/s, N m; m, m/s, N for a joint that slides. Numbers are exact to the last bit.
Of a run whose origin is known, FILE-metadata.json beside the CSV has version, commit, command, seed and the gains of
the law, in the form of the W3C for tables (CSVW); a Parquet file has them in its schema, under pidtsm.

Played. --foxglove adds to the recorded topics what a viewer needs to draw the arm without robot_state_publisher; the
frames of the reference begin with reference/. --rerun has the arm and its reference in motion, position, reference,
error and effort of each joint, and faults, modes and other events. Both need the description of the arm, which a bag
of pidtsm names; for another bag name it with --robot.

Learned from. --format lerobot makes a dataset of LeRobot (v3.0) of demonstrations that were recorded in freedrive or
teleoperation: a folder, which ./pidtsm replay-motion and LeRobot read. Each bag is an episode.

examples:
  ./pidtsm export results/demo --csv demo.csv
  ./pidtsm export results/demo --foxglove
  ./pidtsm export results/demo --rerun --out demo.rrd
  ./pidtsm export my_bag --foxglove --robot my_arm.urdf --out my_bag.mcap
  ./pidtsm export my_bag --messages --parquet my_bag.parquet
  ./pidtsm export first_bag --episodes second_bag --format lerobot --task "Open the door." --out doors
  python -c "import pandas; print(pandas.read_csv('demo.csv', index_col='time').filter(like='error.').abs().max())"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("run", type=Path, metavar="RUN", help="result folder, any bag, or recording.npz")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="file to write, as CSV")
    parser.add_argument("--parquet", type=Path, metavar="FILE", help="file to write, as Parquet (needs pyarrow)")
    parser.add_argument("--messages", action="store_true", help="one row per message and joint, also of a run")
    parser.add_argument(
        "--format",
        choices=("lerobot", "csv", "parquet"),
        help="what to write to --out (default: beside the bag, with its name: BAG_lerobot, BAG.csv, BAG.parquet)",
    )
    add_played_arguments(parser)
    add_demonstration_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    if options.format == "lerobot":
        if others := [name for name in ("csv", "parquet", "messages", "foxglove", "rerun") if getattr(options, name)]:
            raise UsageError(f"--format lerobot and --{others[0]}: export one after the other")
        write_demonstrations(options)
        return 0
    refuse_demonstration_options(options)
    if options.format and getattr(options, options.format) is None:
        named = options.out or options.run.with_name(f"{options.run.absolute().stem}.{options.format}")
        setattr(options, options.format, named)
        options.out = None
    played = played_formats(options)
    if options.csv is None and options.parquet is None and not played:
        raise UsageError(
            "export: name a file with --csv or --parquet, or ask for --foxglove, --rerun or --format lerobot"
        )
    places = {
        option: writable_file(file, f"--{option}")
        for option, file in (("csv", options.csv), ("parquet", options.parquet))
        if file is not None
    }
    if "csv" in places:
        writable_file(_beside(places["csv"]), "--csv")
    if "parquet" in places:
        _pyarrow()
    for name, place in played.items():
        write_played(name, options, place)
    if not places:
        return 0
    table, text, origin = _table(options.run, options.messages)
    for option, place in places.items():
        write_file(place, _csv(table) if option == "csv" else _parquet(table, origin))
        if option == "csv" and origin:
            write_file(_beside(place), _described(table, place.name, origin))
        CONSOLE.print(f"{getattr(options, option)}: {text}", highlight=False)
    return 0


def _beside(place: Path) -> Path:
    """The file that describes a CSV file, with the name that CSVW specifies."""
    return place.with_name(f"{place.name}-metadata.json")


def _described(table: Table, name: str, origin: Mapping[str, Any]) -> str:
    """What CSVW says of a table of numbers."""
    columns = [{"name": quote(column, safe=""), "titles": column, "datatype": "double"} for column in table]
    content = {
        "@context": "http://www.w3.org/ns/csvw",
        "url": quote(name),
        "tableSchema": {"columns": columns},
        "notes": [origin],
    }
    return json.dumps(content, indent=2) + "\n"


def _origin(run: Path, recording: Recording) -> dict[str, Any]:
    """What has made a run; empty if it is not known."""
    if recording.version is None:
        return {}
    return {
        "pidtsm": recording.version,
        "commit": recording.commit,
        "command": (origin_of(run) or {}).get("command"),
        "seed": recording.seed,
        "scenario": recording.scenario,
        "gains": {f"law.{name}": value for name, value in recording.gains.items()},
    }


def _table(run: Path, messages: bool) -> tuple[Table, str, dict[str, Any]]:
    """The table, what it has, and what has made it, see `_origin`.

    Raises:
        UsageError: it cannot be read.
    """
    refused = ""
    if not messages:
        try:
            recording = read(run)
            text = f"{recording.time.size} samples of {len(recording.joints)} joints"
            return sample_table(recording), text, _origin(run, recording)
        except UsageError as error:
            refused = str(error)
    bag = bag_of(run)
    try:
        table = message_table(bag)
    except RecordingError as error:
        raise UsageError(refused or str(error)) from None
    why = "" if messages else f" (no run: {refused})"
    return table, f"{len(table['topic'])} rows, one for each joint of a message{why}", {}


def _csv(table: Table) -> str:
    """A header and one line per row; empty cells where there is no value, in a table of messages."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(table)
    columns = list(table.values())
    if all(isinstance(column, np.ndarray) and column.dtype == float for column in columns):
        np.savetxt(text, np.column_stack(columns), "%.17g", ",")
    else:
        csv.writer(text, lineterminator="\n").writerows(zip(*map(_cells, columns), strict=True))
    return text.getvalue()


def _cells(column: Any) -> Any:
    if isinstance(column, np.ndarray) and column.dtype == float:
        return ("" if math.isnan(value) else f"{value:.17g}" for value in column.tolist())
    return column


def _parquet(table: Table, origin: Mapping[str, Any]) -> bytes:
    arrow = _pyarrow()
    from pyarrow import parquet

    columns = {}
    for name, column in table.items():
        if isinstance(column, np.ndarray):
            columns[name] = arrow.array(column, from_pandas="topic" in table)  # nan of a message: no value
        else:
            columns[name] = arrow.array(column).dictionary_encode()
    text = io.BytesIO()
    parquet.write_table(arrow.table(columns, metadata={"pidtsm": json.dumps(origin)} if origin else None), text)
    return text.getvalue()


def _pyarrow() -> Any:
    """Raises: UsageError: it is not installed."""
    try:
        import pyarrow
    except ModuleNotFoundError:
        raise UsageError(f"--parquet needs pyarrow: {how_to_install('parquet')}") from None
    return pyarrow
