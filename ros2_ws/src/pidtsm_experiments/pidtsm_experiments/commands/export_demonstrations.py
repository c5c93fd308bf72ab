"""``./pidtsm export --format lerobot``: recorded demonstrations as a dataset for learning."""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.motions import SOURCES, StampedPositions, read_stamped_positions
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.export.lerobot import Demonstration, new_folder, require_pyarrow, write_dataset
from pidtsm_experiments.runs.saved import bag_of

_FPS, _FASTEST = 30, 1000
_TASK = "Repeat the demonstrated motion."
_ONLY = {"fps": "--fps", "task": "--task", "actions": "--actions", "episodes": "--episodes"}


def add_demonstration_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``--format lerobot``; they are None unless they are given."""
    group = parser.add_argument_group("--format lerobot (needs pyarrow)")
    group.add_argument("--fps", type=int, metavar="N", help=f"frames per second (default: {_FPS})")
    group.add_argument("--task", metavar="TEXT", help=f"what is demonstrated (default: {_TASK!r})")
    group.add_argument(
        "--actions",
        choices=tuple(SOURCES),
        help="joint_states: the posture of the next frame, as in freedrive (default); reference: what was desired, as "
        "in teleoperation",
    )
    group.add_argument("--episodes", type=Path, nargs="+", metavar="BAG", help="further bags, one for each episode")


def refuse_demonstration_options(options: argparse.Namespace) -> None:
    """Raises: UsageError: an option of ``--format lerobot`` is given without it."""
    if given := [option for name, option in _ONLY.items() if getattr(options, name) is not None]:
        raise UsageError(f"{', '.join(given)}: for --format lerobot alone")


def write_demonstrations(options: argparse.Namespace) -> None:
    """Write the dataset, and print what it has.

    Raises:
        UsageError: an option is bad, a bag cannot be read or has other joints, or pyarrow is not installed.
        RunError: the dataset cannot be written.
    """
    fps = _FPS if options.fps is None else options.fps
    task = _TASK if options.task is None else options.task
    if not 0 < fps <= _FASTEST:
        raise UsageError(f"--fps {fps}: must be 1 to {_FASTEST}")
    if not task.strip():
        raise UsageError("--task: must not be empty")
    require_pyarrow()
    bags = (options.run, *(options.episodes or ()))
    if absent := [bag for bag in bags if not bag.exists()]:
        raise UsageError(f"{absent[0]}: no such file or folder")
    folder = new_folder(options.out or options.run.with_name(f"{options.run.absolute().stem}_lerobot"))
    episodes: list[Demonstration] = []
    robot: str | None = None
    for bag in bags:
        try:
            states = read_stamped_positions(bag_of(bag), "joint_states")
            desired = read_stamped_positions(bag_of(bag), "reference") if options.actions == "reference" else None
        except RecordingError as error:
            raise UsageError(str(error)) from None
        episodes.append(_episode(bag, states, desired, fps))
        if set(episodes[-1].joints) != set(episodes[0].joints):
            raise UsageError(f"{bag}: has {', '.join(states.joints)}; the first bag {', '.join(episodes[0].joints)}")
        episodes[-1] = _ordered(episodes[-1], episodes[0].joints)
        robot = robot or _robot(states.robot)
    write_dataset(folder, episodes, fps, task, robot)
    frames = sum(len(episode.state) for episode in episodes)
    text = f"{len(episodes)} episodes, {frames} frames of {len(episodes[0].joints)} joints at {fps} per second"
    CONSOLE.print(f"{folder}: {text}", highlight=False, soft_wrap=True)


def _episode(bag: Path, states: StampedPositions, desired: StampedPositions | None, fps: int) -> Demonstration:
    """Positions at a regular rate.

    Raises:
        UsageError: they do not last for two frames.
    """
    first, last = states.stamps[0], states.stamps[-1]
    if desired is not None:
        if set(desired.joints) != set(states.joints):
            raise UsageError(
                f"{bag}: the reference has {', '.join(desired.joints)}; the arm {', '.join(states.joints)}"
            )
        first, last = max(first, desired.stamps[0]), min(last, desired.stamps[-1])
    frames = int((last - first) * fps // NANOSECONDS) + 1
    if frames < 2:
        lasts = max(float(last - first), 0.0) / NANOSECONDS
        raise UsageError(f"{bag}: lasts {lasts:.3g} s; two frames at {fps} per second are needed")
    times = np.arange(frames) / fps
    state = _at(states, first, times)
    if desired is None:
        return Demonstration(states.joints, state, np.concatenate([state[1:], state[-1:]]))
    order = [desired.joints.index(joint) for joint in states.joints]
    return Demonstration(states.joints, state, _at(desired, first, times)[:, order])


def _at(positions: StampedPositions, first: int, times: Array) -> Array:
    """Positions at `times` (s) after `first` (ns), shape (times, joints)."""
    given = (positions.stamps - first) / NANOSECONDS
    return np.stack([np.interp(times, given, column) for column in positions.position.T], axis=1)


def _ordered(episode: Demonstration, joints: tuple[str, ...]) -> Demonstration:
    order = [episode.joints.index(joint) for joint in joints]
    return Demonstration(joints, episode.state[:, order], episode.action[:, order])


def _robot(stored: Mapping[str, object]) -> str | None:
    """Name of the arm; None: unknown."""
    description = str(stored.get(DESCRIPTION.name, ""))
    return None if not description or "<" in description else Path(description).stem
