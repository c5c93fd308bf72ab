"""``./pidtsm export``: a run or a bag for other programs, as a table or to be played."""

import argparse
import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.tables import Table, message_table, sample_table
from pidtsm_experiments.commands.export_played import add_played_arguments, played_formats, write_played
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.files import writable_file, write_file
from pidtsm_experiments.runs.saved import bag_of

_EPILOG = """Tables. A run has one row per sample: time (s); position, velocity, error, effort, reference and signals of
the controller for each joint, in columns such as effort.joint2.

Any other bag, and any with --messages, has one row for each joint of each message whose type has joint names, such as
sensor_msgs/JointState: topic, time (s, since the earliest stamp), stamp (ns), joint, and the fields of the messages,
such as position; cells are empty where a message lacks a field.

Units are those of the messages: rad, rad/s, N m; m, m/s, N for a joint that slides. Numbers are exact to the last bit.

Played. --foxglove adds to the recorded topics what a viewer needs to draw the arm without robot_state_publisher; the
frames of the reference begin with reference/. --rerun has the arm and its reference in motion, position, reference,
error and effort of each joint, and faults, modes and other events. Both need the description of the arm, which a bag
of pidtsm names; for another bag name it with --robot.

examples:
  ./pidtsm export results/demo --csv demo.csv
  ./pidtsm export results/demo --foxglove
  ./pidtsm export results/demo --rerun --out demo.rrd
  ./pidtsm export my_bag --foxglove --robot my_arm.urdf --out my_bag.mcap
  ./pidtsm export my_bag --messages --parquet my_bag.parquet
  python -c "import pandas; print(pandas.read_csv('demo.csv', index_col='time').filter(like='error.').abs().max())"
"""
_INSTALL = "./pidtsm shell -c 'python -m pip install --no-deps --require-hashes -r requirements/parquet.lock'"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("run", type=Path, metavar="RUN", help="result folder, any bag, or recording.npz")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="file to write, as CSV")
    parser.add_argument("--parquet", type=Path, metavar="FILE", help="file to write, as Parquet (needs pyarrow)")
    parser.add_argument("--messages", action="store_true", help="one row per message and joint, also of a run")
    add_played_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    played = played_formats(options)
    if options.csv is None and options.parquet is None and not played:
        raise UsageError("export: name a file with --csv or --parquet, or ask for --foxglove or --rerun")
    places = {
        option: writable_file(file, f"--{option}")
        for option, file in (("csv", options.csv), ("parquet", options.parquet))
        if file is not None
    }
    if "parquet" in places:
        _pyarrow()
    for name, place in played.items():
        write_played(name, options, place)
    if not places:
        return 0
    table, text = _table(options.run, options.messages)
    for option, place in places.items():
        write_file(place, _csv(table) if option == "csv" else _parquet(table))
        CONSOLE.print(f"{getattr(options, option)}: {text}", highlight=False)
    return 0


def _table(run: Path, messages: bool) -> tuple[Table, str]:
    """The table, and what it has.

    Raises:
        UsageError: it cannot be read.
    """
    refused = ""
    if not messages:
        try:
            recording = read(run)
            return sample_table(recording), f"{recording.time.size} samples of {len(recording.joints)} joints"
        except UsageError as error:
            refused = str(error)
    bag = bag_of(run)
    try:
        table = message_table(bag)
    except RecordingError as error:
        raise UsageError(refused or str(error)) from None
    why = "" if messages else f" (no run: {refused})"
    return table, f"{len(table['topic'])} rows, one for each joint of a message{why}"


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


def _parquet(table: Table) -> bytes:
    arrow = _pyarrow()
    from pyarrow import parquet

    columns = {}
    for name, column in table.items():
        if isinstance(column, np.ndarray):
            columns[name] = arrow.array(column, from_pandas="topic" in table)  # nan of a message: no value
        else:
            columns[name] = arrow.array(column).dictionary_encode()
    text = io.BytesIO()
    parquet.write_table(arrow.table(columns), text)
    return text.getvalue()


def _pyarrow() -> Any:
    """Raises: UsageError: it is not installed."""
    try:
        import pyarrow
    except ModuleNotFoundError:
        raise UsageError(f"--parquet needs pyarrow: {_INSTALL}") from None
    return pyarrow
