"""``./pidtsm gains``: a first set of gains for an arm."""

import argparse
import json
from pathlib import Path
from textwrap import fill

from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.gains import BITS, DELAY, RATE, first_gains
from pidtsm_core.experiment.law_gains import Gain
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Value
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm, settings_of
from pidtsm_experiments.runs.files import writable_file, write_file
from pidtsm_experiments.runs.origin import comment

_EPILOG = """The rule needs the inertias of the arm and the quality of its sensors. It is a start; docs/tuning.md shows
how to go on.

example:
  ./pidtsm gains --robot panda --encoder-bits 17 --delay 2 --out panda.yaml
  ./pidtsm rollout --robot panda --params panda.yaml --set simulator.encoder.bits=17
"""
_WIDTH = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    add_arm_arguments(parser)
    parser.add_argument("--law", choices=LAWS.names, default=LAW_NAME.default, help="default: %(default)s")
    parser.add_argument(
        "--encoder-bits",
        type=int,
        default=BITS,
        metavar="N",
        help="resolution of the encoders, 2^N steps per revolution, or per metre; 0: ideal (default: %(default)s)",
    )
    parser.add_argument(
        "--delay",
        type=float,
        default=1e3 * DELAY,
        metavar="MS",
        help="from a position to its joint state plus from a command to its torque, ms (default: %(default)g)",
    )
    parser.add_argument(
        "--rate", type=float, default=RATE, metavar="HZ", help="joint states per second (default: %(default)g)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write a parameter file for --params and for the node")
    parser.add_argument("--json", action="store_true", help="print one JSON object: by parameter, value and reason")


def execute(options: argparse.Namespace) -> int:
    if not 0 <= options.encoder_bits <= 40:
        raise UsageError(f"--encoder-bits {options.encoder_bits}: must be from 0 to 40")
    if not 0.0 <= options.delay <= 1000.0:
        raise UsageError(f"--delay {options.delay:g}: must be from 0 to 1000 ms")
    if not 1.0 <= options.rate <= 100_000.0:
        raise UsageError(f"--rate {options.rate:g}: must be from 1 to 100000 Hz")
    place = None if options.out is None else writable_file(options.out)
    arm = settings_of(read_arm(options))
    gains = first_gains(arm, options.encoder_bits, 1e-3 * options.delay, options.rate, options.law)
    introduce(options)
    text = comment() + _parameter_file(gains)
    if options.json:
        print(json.dumps({gain.name: {"value": gain.value, "reason": gain.reason} for gain in gains}))
    else:
        print(text, end="")
    if place is not None:
        write_file(place, text)
    return 0


def _parameter_file(gains: tuple[Gain, ...]) -> str:
    """ROS parameter file of the controller, with the reason above each parameter."""
    lines = ["controller:", "  ros__parameters:"]
    for gain in gains:
        lines.append(fill(gain.reason, _WIDTH, initial_indent="    # ", subsequent_indent="    # "))
        lines.append(f"    {gain.name}: {_text(gain.value)}")
    return "\n".join(lines) + "\n"


def _text(value: Value) -> str:
    """A value in YAML."""
    if isinstance(value, str):
        return value
    return json.dumps(list(value) if isinstance(value, tuple) else value)
