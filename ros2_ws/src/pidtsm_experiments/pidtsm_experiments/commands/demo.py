"""``./pidtsm demo``: Case 1, or the default motion of another arm, with the proposed law and the real nodes.

Where ROS is not installed, the same loop runs without nodes.
"""

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import (
    add_engine_argument,
    engine_overrides,
    require_followed,
    show_metrics,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser)
    add_engine_argument(parser)
    parser.add_argument(
        "--blind",
        type=_seed,
        metavar="SEED",
        help="run an arm with none, one or two faults that only the seed knows; ./pidtsm diagnose finds them, and the "
        "report of the diagnosis opens the truth at its end (docs/diagnose.md)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: results/demo, or results/blind-SEED with --blind"
    )


def execute(options: argparse.Namespace) -> int:
    if options.blind is not None:
        return _blind(options)
    experiment = make_experiment(None, overrides=engine_overrides(options.engine), robot=read_arm(options))
    introduce(options)
    demonstrate = _with_nodes if find_spec("rclpy") else _without_ros
    require_followed(demonstrate(experiment, options.out or Path("results", "demo")))
    return 0


def _with_nodes(experiment: Experiment, out: Path) -> dict[str, Any]:
    from pidtsm_experiments.commands.run import run_and_report  # Needs ROS.

    return run_and_report(experiment, "lockstep", out).metrics()


def _without_ros(experiment: Experiment, out: Path) -> dict[str, Any]:
    from pidtsm_experiments.commands.rollout import kept

    print("pidtsm: ROS 2 is not installed: the same loop runs as one compiled function, without nodes", file=sys.stderr)
    metrics = kept(experiment, out)
    show_metrics(metrics, as_json=False)
    return metrics


def _blind(options: argparse.Namespace) -> int:
    """Run a blind arm; a controller that does not follow is no failure here."""
    if not find_spec("rclpy"):
        raise UsageError("--blind runs the real nodes, and ROS 2 is not installed")
    # Slow to import, and not needed by the usual demo.
    from pidtsm_experiments.runs.blind import run_blind

    out = options.out or Path("results", f"blind-{options.blind}")
    robot = read_arm(options)
    introduce(options)
    run_blind(options.blind, robot, engine_overrides(options.engine), out)
    print(f"pidtsm: what is wrong with it? ./pidtsm diagnose {out}", file=sys.stderr)
    return 0


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)
