"""What ``./pidtsm export`` writes for viewers that play a run: Foxglove, RViz and rerun."""

import argparse
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from pidtsm_core.errors import UsageError
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.commands.arm_options import add_arm_arguments, given_arm, introduce, read_arm
from pidtsm_experiments.commands.options import CONSOLE, progress_bar, read
from pidtsm_experiments.runs.files import writable_file, write_file, written_file
from pidtsm_experiments.runs.saved import RECORDING, bag_of, read_parameters

_ENDS = {"foxglove": "_foxglove.mcap", "rerun": ".rrd"}


def add_played_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the formats that viewers play."""
    parser.add_argument(
        "--foxglove",
        action="store_true",
        help="write an MCAP file that Foxglove and RViz play: the recorded topics, /robot_description, /tf and "
        "/tf_static of the arm and of its reference",
    )
    parser.add_argument(
        "--rerun",
        action="store_true",
        help="write a file for the viewer rerun: the moving arm, its curves and what happened (needs rerun-sdk)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file of --foxglove or --rerun (default: beside the run, with its name: RUN_foxglove.mcap, RUN.rrd)",
    )
    add_arm_arguments(parser, of="the recording, if it does not name one or if the description has moved")


def played_formats(options: argparse.Namespace) -> dict[str, Path]:
    """The files to write, by format; empty: none is asked for.

    Raises:
        UsageError: a file cannot be written, or would replace the run.
    """
    asked = [name for name in _ENDS if getattr(options, name)]
    if options.out is not None and len(asked) != 1:
        reason = "name one of them" if asked else "it needs --foxglove or --rerun; --csv and --parquet name their file"
        raise UsageError(f"--out is the file of --foxglove or --rerun: {reason}")
    if given_arm(options) is not None and not asked:
        raise UsageError("--robot is for --foxglove and --rerun; a table needs no arm")
    run = Path(options.run.absolute())
    bag = bag_of(run).resolve()
    found = {}
    for name in asked:
        file = options.out or options.run.with_name(f"{run.stem}{_ENDS[name]}")
        place = writable_file(file)
        if bag in (place, place.parent):
            raise UsageError(f"--out {file}: is a part of the bag; name another file")
        found[name] = place
    return found


def write_played(name: str, options: argparse.Namespace, place: Path) -> None:
    """Write one of the files of `played_formats`, and print what it has.

    Raises:
        UsageError: the run cannot be read, its arm is not known, or rerun-sdk is not installed.
        RunError: the file cannot be written.
    """
    given = read_arm(options)
    robot = None if given is None else given.settings()
    introduce(options)
    text = {"foxglove": _foxglove, "rerun": _rerun}[name](options.run, robot, place)
    CONSOLE.print(f"{place}: {text}", highlight=False, soft_wrap=True)


def _foxglove(run: Path, robot: Mapping[str, object] | None, place: Path) -> str:
    from pidtsm_experiments.export.foxglove import write_foxglove

    try:
        with _bag(run) as bag, _progress("copying") as advance, written_file(place) as stream:
            played = write_foxglove(bag, robot, stream, advance)
    except RecordingError as error:
        raise UsageError(str(error)) from None
    arms = "the arm and its reference" if played.ghost else "the arm (the bag has no reference)"
    text = f"{played.messages} messages, and {played.moments} transforms of {arms}, from {played.source}"
    if not played.described:
        text = f"{text}; viewers cannot read an MJCF, so they show frames and markers"
    return f"{text}; the bag was not finished ({'; '.join(played.flaws)})" if played.flaws else text


def _rerun(run: Path, robot: Mapping[str, object] | None, place: Path) -> str:
    from pidtsm_experiments.export.arm import drawn_arm
    from pidtsm_experiments.export.rerun_file import require_rerun, rerun_file

    require_rerun()
    recording = read(run)
    arm = drawn_arm(recording.robot if robot is None else robot)
    simulator = read_parameters(run).get("simulator", recording.robot)
    with CONSOLE.status("drawing the arm"):
        shown = rerun_file(recording, arm, simulator, run.absolute().stem)
    write_file(place, shown.content)
    text = f"{recording.time.size} samples, {shown.moments} pictures of the arm and its reference, {shown.marks} events"
    return f"{text}; meshes that are not drawn, as their files are not here: {shown.lacking}" if shown.lacking else text


@contextmanager
def _bag(run: Path) -> Iterator[Path]:
    """The bag of a run, or one that is made of a rollout that left none.

    Raises:
        UsageError: the rollout cannot be read, or its parameters are gone.
    """
    from pidtsm_experiments.bags.rollout_bag import write_rollout_bag

    if not (run / RECORDING).is_file():
        yield bag_of(run)
        return
    recording, given = read(run), read_parameters(run).get("trajectory", {})
    trajectory = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    if not {"joints", "feedforward.effort"} <= trajectory.keys():
        raise UsageError(f"{run}: params/trajectory.yaml is gone or not complete; repeat the rollout with --bag")
    with TemporaryDirectory(prefix="pidtsm-") as folder:
        write_rollout_bag(recording, trajectory, Path(folder, run.absolute().name))
        yield Path(folder, run.absolute().name)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar, and a function that advances it to a number of steps of all."""
    with progress_bar() as bar:
        task = bar.add_task(what)
        yield lambda done, of: bar.update(task, completed=done, total=of)
