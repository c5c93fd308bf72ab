"""``./pidtsm replay``: a result made again from what it records, and whether the bits agree."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pidtsm_core.control.parameters import ESTIMATOR_NAME, LAW_NAME
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.robots.definition import resolved_description
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.reasons import NOTHING_KNOWN, REALTIME, reasons
from pidtsm_experiments.runs.replay import (
    Agreement,
    Difference,
    agreement,
    contradictions,
    experiment_of_result,
    new_parameters,
    origin_of_result,
)
from pidtsm_experiments.runs.results import result_folder

_EPILOG = """The result is made again from the parameters in its run.json, not from its command line, and not from files
of parameters or scenarios that may have changed since. A run with nodes in lockstep is made again without them, which
gives the same bits. Everything that the simulation decides is compared bit for bit, at equal stamps: true motion and
effort, reference, the controller's signals and status. Read for that are recording.npz or the bag.

If bits differ, the first sample, joint and quantity that differ are named, and what is different here: version or
commit, libraries, the functions of the C library, the processor, files that parameters name. A small difference grows
during a run; the first one says most.

A run in real time, of a real arm, or of a law that is not installed here cannot be made again; the reason is printed.

exit codes: 0 the bits agree, 1 they differ or the result cannot be made again here, 2 it is not the result of a run

examples:
  ./pidtsm rollout --law pid --out results/pid
  ./pidtsm replay results/pid
  ./pidtsm replay results/pid/run.json --json
  ./pidtsm replay colleague/arm --description my_arm.urdf --out results/again
  ./pidtsm compare colleague/arm results/again
"""
_CHOICES = (
    LAW_NAME.name,
    "law.surface",
    "law.manifold",
    "law.reaching",
    ESTIMATOR_NAME.name,
    "reference.name",
    "disturbance.name",
    DESCRIPTION.name,
)
"""Parameters whose values may be members from outside."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument(
        "result", type=Path, metavar="RESULT", help="result folder of run, demo or rollout, its run.json or bag"
    )
    parser.add_argument(
        "--description",
        metavar="FILE",
        help="of the arm, if the recorded path leads nowhere on this machine",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="keep what was made again, as a result folder of rollout"
    )
    parser.add_argument("--json", action="store_true", help="print only the outcome, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    result: Path = options.result.parent if options.result.name == "run.json" else options.result
    origin, recording = origin_of_result(result), read(result)
    robot = None if options.description is None else resolved_description(options.description)
    again, found, why = None, None, []
    if recording.clock == "realtime":
        why = [REALTIME]
    else:
        try:
            experiment = experiment_of_result(recording, origin["parameters"], robot)
            again = rollout(experiment)
        except ParameterError as error:
            why = [_refused(error), *reasons(origin, robot)]
        except DivergedError as error:
            why = [f"made again, {error}", *reasons(origin, robot)]
        else:
            found = agreement(recording, again)
            why = [*_of_parameters(origin, recording, experiment), *reasons(origin, robot)]
            if options.out:
                _keep(experiment, again, options.out, result)
    agrees = found is not None and found.agrees
    if options.json:
        print(json.dumps(_content(origin, found, why), allow_nan=False))
    else:
        _show(options.result, origin, recording, found, why)
    return 0 if agrees else 1


def _refused(error: ParameterError) -> str:
    text = f"this version or installation refuses a parameter of the result: {error}"
    if error.parameter.partition(".")[2] in _CHOICES or any(name in str(error) for name in _CHOICES):
        text += " (a member from outside, or a file, that is not on this machine?)"
    return text


def _of_parameters(origin: Any, recording: Recording, experiment: Experiment) -> Iterator[str]:
    """What is odd about the parameters of a result."""
    parameters = origin["parameters"]
    if added := new_parameters(parameters, experiment):
        yield f"the result lacks parameters of this version, whose defaults were used: {', '.join(added)}"
    if other := contradictions(parameters, recording.parameters):
        yield f"run.json has other values than what was recorded: {', '.join(other)}"


def _keep(experiment: Experiment, again: Recording, out: Path, result: Path) -> None:
    # Libraries for drawing take longer to import than a rollout takes.
    from pidtsm_experiments.runs.outputs import write_outputs
    from pidtsm_experiments.runs.saved import RECORDING, save_recording, write_parameters

    with result_folder(out, MadeOf(runs=(result,))) as folder:
        write_parameters(experiment.values, folder)
        save_recording(again, folder / RECORDING)
        write_outputs(again, folder)
    CONSOLE.print(f"{out}: report.html metrics.json figures/ params/ recording.npz", highlight=False)


def _content(origin: Any, found: Agreement | None, why: Sequence[str]) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "agree": found is not None and found.agrees,
        "samples": 0 if found is None else found.samples,
        "lacking": None if found is None else found.lacking,
        "surplus": None if found is None else found.surplus,
        "compared": [] if found is None else list(found.compared),
        "differences": [] if found is None else [asdict(each) for each in found.differences],
        "different_here": list(why),
        "made_by": {key: origin.get(key) for key in ("version", "commit", "command", "environment")},
    }


def _show(path: Path, origin: Any, recording: Recording, found: Agreement | None, why: Sequence[str]) -> None:
    names = ", ".join(filter(None, (recording.scenario, recording.law, recording.clock)))
    made = f"pidtsm {origin['version']}, commit {(origin['commit'] or 'unknown')[:12]}"
    print(f"{path}: {names}, {recording.time.size} samples, made by {made}")
    if found is None:
        print(f"cannot be made again: {why[0]}")
        for text in why[1:]:
            print(f"different here: {text}")
        return
    if found.agrees:
        of_all = f" of {found.samples + found.lacking}, as the result lacks the others" if found.lacking else ""
        print(f"the bits agree: {len(found.compared)} quantities, {found.samples} samples{of_all}")
        for text in why:
            print(f"different here, without effect: {text}")
        return
    if found.surplus or not found.samples:
        print(f"{found.surplus} samples of the result are not there again; {found.samples} are")
    if found.differences:
        print(_first(found.differences[0]))
        for each in found.differences[1:]:
            print(f"  {each.quantity}: from sample {each.sample} on, by at most {each.largest:.3g}")
    for text in why or [NOTHING_KNOWN]:
        print(f"likely reason: {text}")


def _first(first: Difference) -> str:
    of_joint = f" of {first.joint}" if first.joint else ""
    return (
        f"the bits differ, first at sample {first.sample} ({first.time:g} s): {first.quantity}{of_joint} was "
        f"{first.recorded!r}, is now {first.again!r}; by at most {first.largest:.3g} in the whole run"
    )
