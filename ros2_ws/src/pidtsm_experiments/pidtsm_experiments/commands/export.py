"""``./pidtsm export``: the arrays of a run as a table for other programs."""

import argparse
import csv
import io
from pathlib import Path

import numpy as np

from pidtsm_core.recording import Recording
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.files import writable_file, write_file

_EPILOG = """The file has one row per sample: time (s); position, velocity, error, effort, reference and signals of the
controller for each joint, in columns such as effort.joint2, in SI units. Numbers are exact to the last bit.

examples:
  ./pidtsm export results/demo --csv demo.csv
  python -c "import pandas; print(pandas.read_csv('demo.csv', index_col='time').filter(like='error.').abs().max())"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("run", type=Path, metavar="RUN", help="result folder, bag, or recording.npz")
    parser.add_argument("--csv", type=Path, metavar="FILE", required=True, help="file to write")


def execute(options: argparse.Namespace) -> int:
    place = writable_file(options.csv, "--csv")
    recording = read(options.run)
    write_file(place, _csv(recording))
    CONSOLE.print(f"{options.csv}: {recording.time.size} samples of {len(recording.joints)} joints", highlight=False)
    return 0


def _csv(recording: Recording) -> str:
    """A header and one row per sample."""
    arrays = recording.arrays()
    names = ["time", *(f"{name}.{joint}" for name in arrays for joint in recording.joints)]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(names)
    np.savetxt(text, np.column_stack([recording.time, *arrays.values()]), "%.17g", ",")
    return text.getvalue()
