"""``./pidtsm gains``: a first set of gains for an arm."""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.gains import BITS, DELAY, RATE, first_gains
from pidtsm_core.experiment.hardware_classes import hardware_names, hardware_settings
from pidtsm_core.experiment.hardware_gains import hardware_gains
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
        metavar="N",
        help=f"resolution of the encoders, 2^N steps per revolution, or per metre; 0: ideal (default: {BITS})",
    )
    parser.add_argument(
        "--delay",
        type=float,
        metavar="MS",
        help=f"from a position to its joint state plus from a command to its torque, ms (default: {1e3 * DELAY:g})",
    )
    parser.add_argument("--rate", type=float, metavar="HZ", help=f"joint states per second (default: {RATE:g})")
    parser.add_argument(
        "--hardware",
        choices=hardware_names(),
        help="gains for a class of hardware: its sensors, delays, elasticity and friction",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write a parameter file for --params and for the node")
    parser.add_argument("--json", action="store_true", help="print one JSON object: by parameter, value and reason")


def execute(options: argparse.Namespace) -> int:
    arm = settings_of(read_arm(options))
    place = None if options.out is None else writable_file(options.out)
    gains = _gains(options, arm)
    introduce(options)
    text = comment() + _parameter_file(gains)
    if options.json:
        print(json.dumps({gain.name: {"value": gain.value, "reason": gain.reason} for gain in gains}))
    else:
        print(text, end="")
    if place is not None:
        write_file(place, text)
    return 0


def _gains(options: argparse.Namespace, arm: Mapping[str, Any]) -> tuple[Gain, ...]:
    """The gains for what the options say of the hardware.

    Raises:
        UsageError: they say something impossible, or see `first_gains`.
    """
    bits, delay, rate = options.encoder_bits, options.delay, options.rate
    if options.hardware is not None:
        if (bits, delay, rate) != (None, None, None):
            raise UsageError("--hardware has its own resolution, delay and rate; omit it, or what contradicts it")
        return hardware_gains(arm, {**arm, **hardware_settings(options.hardware, arm)}, options.law)
    bits, delay, rate = (
        default if given is None else given for given, default in ((bits, BITS), (delay, 1e3 * DELAY), (rate, RATE))
    )
    if not 0 <= bits <= 40:
        raise UsageError(f"--encoder-bits {bits}: must be from 0 to 40")
    if not 0.0 <= delay <= 1000.0:
        raise UsageError(f"--delay {delay:g}: must be from 0 to 1000 ms")
    if not 1.0 <= rate <= 100_000.0:
        raise UsageError(f"--rate {rate:g}: must be from 1 to 100000 Hz")
    return first_gains(arm, int(bits), 1e-3 * delay, rate, options.law)


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
