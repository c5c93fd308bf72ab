"""``./pidtsm analyze``: metrics of a recorded bag."""

import argparse
import sys
import warnings
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag
from pidtsm_experiments.commands.options import show_metrics


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of a rosbag2 bag, for example results/demo/bag")
    parser.add_argument("--json", action="store_true", help="print only the metrics, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UnfinishedBag)
            metrics = analyze(options.bag)
    except RecordingError as error:
        raise UsageError(str(error)) from None
    for warning in caught:
        print(f"pidtsm: warning: {warning.message}", file=sys.stderr)
    show_metrics(metrics, options.json)
    return 0
