"""``./pidtsm replay-motion``: the recorded motion of a bag, on a running system."""

import argparse
import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.robots import OF_ARM
from pidtsm_core.signals import Mode
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.recorded import (
    RATE,
    RecordedMotion,
    beyond_range,
    largest_effort,
    recorded_motion,
    share_of_velocity,
)
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.motions import SOURCES, read_positions
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import CONSOLE, progress_bar
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.export.lerobot import ACTION, STATE, is_dataset, read_episode
from pidtsm_experiments.runs.saved import bag_of

if TYPE_CHECKING:
    from pidtsm_ros.client import Arm

_EPILOG = f"""The arm first moves to the first posture, on a straight line. Then it gets {RATE} targets per second,
smoothed, as a stream (docs/streams.md), so the node keeps every limit. A motion that exceeds a limit of position,
velocity or torque is refused before. Ctrl-C brings the arm to rest.

examples:
  ./pidtsm replay-motion my_bag --dry-run
  ./pidtsm replay-motion my_bag --speed 0.5
  ./pidtsm replay-motion my_bag --from reference --namespace left
  ./pidtsm replay-motion doors --episode 1

exit codes: 0 the arm is at the last posture, 1 it is not, or the motion exceeds a limit, 2 bad usage or input,
130 interrupted; the arm is at rest
"""
_LINGER = 0.5
"""s for which the last target is repeated, until the reference is there."""
_ARRIVES_WITHIN = 10.0
"""s in which the reference must reach the last posture after the motion."""
_CLOSE = 0.01
"""Largest distance of the reference from the last target, rad or m."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("bag", type=Path, metavar="BAG", help="any bag, a result folder, or a dataset of LeRobot")
    parser.add_argument("--episode", type=int, metavar="N", help="of a dataset of LeRobot (default: 0)")
    parser.add_argument(
        "--from",
        dest="source",
        choices=tuple(SOURCES),
        default="joint_states",
        help="topic with the positions (default: joint_states); of a dataset, joint_states means observation.state, "
        "and reference means action",
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="2: twice as fast (default: 1)")
    parser.add_argument("--dry-run", action="store_true", help="show joints, duration and velocities, and move nothing")
    parser.add_argument("--namespace", default="", metavar="NAME", help="namespace of the system")
    add_arm_arguments(parser, of="the limits, if neither the trajectory node nor the bag has a robot.description")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def execute(options: argparse.Namespace) -> int:
    if not 0.0 < options.speed < 100.0:
        raise UsageError(f"--speed {options.speed:g}: must be above 0 and below 100")
    if (arm := read_arm(options)) is not None:
        arm.settings()  # Refused here if it cannot be used, before the bag is read.
        arm.robot()
    try:
        joints, times, position, stored = _read(options)
        motion = recorded_motion(joints, times, position, options.speed)
    except (RecordingError, TrajectoryError) as error:
        raise UsageError(str(error)) from None
    introduce(options)
    if options.dry_run:
        limits = _known_limits(options, stored)
        if limits is not None:
            motion = _of_arm(motion, limits)
        _show(motion, limits, options.json)
        _require_limits(motion, limits, options.speed)
        return 0
    return _replay(motion, options)


def _read(options: argparse.Namespace) -> tuple[tuple[str, ...], Array, Array, Mapping[str, object]]:
    """As `read_positions`, also of a dataset, which has no parameters of the robot."""
    if is_dataset(options.bag):
        feature = STATE if options.source == "joint_states" else ACTION
        return *read_episode(options.bag, options.episode or 0, feature), {}
    if options.episode is not None:
        raise UsageError(f"--episode {options.episode}: {options.bag} is no dataset of LeRobot")
    return read_positions(bag_of(options.bag), options.source)


def _known_limits(options: argparse.Namespace, stored: Any) -> MotionLimits | None:
    """The limits of the arm that the options or the bag name; None: none is known."""
    arm = read_arm(options)
    settings = arm.settings() if arm is not None else {key: stored[key] for key in OF_ARM if key in stored}
    return motion_limits(settings) if settings else None


def _of_arm(motion: RecordedMotion, limits: MotionLimits) -> RecordedMotion:
    """The joints of the arm, in its order.

    Raises:
        UsageError: the bag lacks one.
    """
    if missing := [joint for joint in limits.joints if joint not in motion.joints]:
        raise UsageError(f"the bag lacks {', '.join(missing)}; it has {', '.join(motion.joints)}")
    order = [motion.joints.index(joint) for joint in limits.joints]
    q, dq, ddq = (values[:, order] for values in (motion.position, motion.velocity, motion.acceleration))
    return RecordedMotion(limits.joints, motion.time, q, dq, ddq)


def _require_limits(motion: RecordedMotion, limits: MotionLimits | None, speed: float) -> None:
    """Require that the arm can do the motion.

    Args:
        motion: the motion, with the joints of the limits.
        limits: of the arm; None: unknown.
        speed: of ``--speed``, with which the motion was read.

    Raises:
        RunError: the motion exceeds a limit.
    """
    if limits is None:
        return
    if beyond := beyond_range(motion, limits):
        raise RunError(f"the motion leaves the range of the arm: {beyond}")
    shares = share_of_velocity(motion, limits)
    if (share := float(shares.max())) > 1.0:
        j = int(shares.argmax())
        largest, allowed = np.abs(motion.velocity[:, j]).max(), limits.planned_velocity[j]
        raise RunError(
            f"{motion.joints[j]} would move with {largest:.3g} {limits.units[j].position}/s; at most {allowed:.3g} is "
            f"allowed; use --speed {_floor(0.99 * speed / share)}"
        )
    effort = largest_effort(motion, limits)
    if effort is not None and (effort > limits.effort).any():
        j = int((effort / limits.effort).argmax())
        raise RunError(
            f"{motion.joints[j]} would need {effort[j]:.3g} {limits.units[j].effort} by the model; at most "
            f"{limits.effort[j]:.3g} is allowed; a lower --speed may need less"
        )


def _floor(value: float) -> str:
    """A number with two digits that is not larger."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.floor(value / unit) * unit:.2g}"


def _summary(motion: RecordedMotion, limits: MotionLimits | None) -> dict[str, Any]:
    """What ``--json`` prints of a motion; without limits, those are null."""
    effort = None if limits is None else largest_effort(motion, limits)
    rows = []
    for j, joint in enumerate(motion.joints):
        rows.append(
            {
                "joint": joint,
                "first": float(motion.position[0, j]),
                "smallest": float(motion.position[:, j].min()),
                "largest": float(motion.position[:, j].max()),
                "velocity": float(np.abs(motion.velocity[:, j]).max()),
                "velocity_allowed": _finite(limits.planned_velocity[j]) if limits is not None else None,
                "effort": None if effort is None else float(effort[j]),
                "effort_allowed": _finite(limits.effort[j]) if limits is not None else None,
            }
        )
    return {"duration": motion.duration, "targets": int(motion.time.size), "joints": rows}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _show(motion: RecordedMotion, limits: MotionLimits | None, as_json: bool) -> None:
    summary = _summary(motion, limits)
    if as_json:
        print(json.dumps(summary))
        return
    print(f"{summary['duration']:.2f} s, {summary['targets']} targets")
    for row in summary["joints"]:
        allowed = "no limit known" if row["velocity_allowed"] is None else f"at most {row['velocity_allowed']:.3g}"
        effort = "" if row["effort"] is None else f", effort up to {row['effort']:.3g} by the model"
        if effort and row["effort_allowed"] is not None:
            effort += f" (at most {row['effort_allowed']:.3g})"
        print(
            f"{row['joint']}: from {row['first']:.4f}, within {row['smallest']:.4f} to {row['largest']:.4f}, "
            f"velocity up to {row['velocity']:.3g} ({allowed}){effort}"
        )


def _replay(motion: RecordedMotion, options: argparse.Namespace) -> int:
    from pidtsm_ros.client import Arm, ArmError  # Only this command and move need rclpy.

    robot = read_arm(options)
    try:
        with Arm(options.namespace, robot or "") as arm:
            motion = _of_arm(motion, arm.limits)
            _require_limits(motion, arm.limits, options.speed)
            if arm.state.mode != Mode.FOLLOWING:
                raise RunError(f"the controller does not follow its reference: it is {arm.state.mode.name.lower()}")
            try:
                arm.move_to(motion.position[0])
                _stream(arm, motion)
                arm.hold()
            except KeyboardInterrupt:
                arm.hold()
                raise
            state = arm.state
    except ArmError as error:
        raise RunError(str(error)) from None
    distance = float(np.abs(state.desired[0] - motion.position[-1]).max())
    if options.json:
        position = dict(zip(state.names, state.position.tolist(), strict=True))
        print(json.dumps({"duration": motion.duration, "position": position, "distance": distance}))
    if distance > _CLOSE:
        raise RunError(f"the reference is {distance:.3g} from the last posture; see the log of the trajectory node")
    if not options.json:
        print("there: " + ", ".join(f"{name} {q:.4f}" for name, q in zip(state.names, state.position, strict=True)))
    return 0


def _stream(arm: "Arm", motion: RecordedMotion) -> None:
    """Send the targets in time, and the last one until the reference is there.

    Raises:
        RunError: the controller stops.
    """
    CONSOLE.print(f"moving for {motion.duration:.2f} s", highlight=False)
    linger = np.arange(1, round(_LINGER * RATE) + 1) / RATE
    due = np.concatenate([motion.time, motion.duration + linger])
    targets = np.concatenate([motion.position, np.repeat(motion.position[-1:], linger.size, axis=0)])
    begin = time.monotonic()
    with progress_bar() as bar:
        task = bar.add_task("replaying", total=motion.duration)
        for k, (at, target) in enumerate(zip(due, targets, strict=True)):
            time.sleep(max(0.0, begin + at - time.monotonic()))
            arm.stream(target)
            if k % (RATE // 10) == 0:
                bar.update(task, completed=at)
                if fault := arm.state.fault:
                    raise RunError(f"the controller has stopped: {fault}; then ./pidtsm nodes reset")
        end = time.monotonic() + _ARRIVES_WITHIN
        while _distance(arm, motion) > _CLOSE and time.monotonic() < end:  # On a busy machine it comes late.
            arm.stream(targets[-1])
            time.sleep(1.0 / RATE)


def _distance(arm: "Arm", motion: RecordedMotion) -> float:
    """Largest distance of the reference from the last posture, rad or m."""
    return float(np.abs(arm.state.desired[0] - motion.position[-1]).max())
