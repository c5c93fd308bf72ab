"""``./pidtsm move``: move the arm of a running system."""

import argparse
import json
import time
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.errors import RunError

_EPILOG = """With --to, the arm moves on the straight line between its posture and the new one, as fast as its limits
allow; with --pose, its tool moves on a straight line, or with --via on the arc of a circle. Ctrl-C brings it to rest.

examples:
  ./pidtsm move --to 0.3 -0.2
  ./pidtsm move --to joint2=0.1 --velocity-scale 0.3
  ./pidtsm move --pose 0.4 0.1 0.5 --speed 0.1

exit codes: 0 the arm is there, 1 it is not, 2 bad usage or input, 130 interrupted; the arm is at rest
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--to", nargs="+", metavar="Q", help="position of every joint, rad or m, or JOINT=Q for some of them"
    )
    where.add_argument(
        "--pose",
        nargs="+",
        type=float,
        metavar="X",
        help="position of the tool x y z, m, and its quaternion x y z w (default: its orientation of now)",
    )
    parser.add_argument(
        "--via", nargs=3, type=float, metavar="X", help="with --pose: point x y z on the arc of the tool, m"
    )
    parser.add_argument(
        "--frame", default="", metavar="LINK", help="with --pose: link that all this is seen from (default: the base)"
    )
    parser.add_argument(
        "--speed", type=float, default=0.25, metavar="V", help="with --pose: of the tool, m/s (default: 0.25)"
    )
    parser.add_argument("--namespace", default="", metavar="NAME", help="namespace of the system")
    add_arm_arguments(parser, of="the limits, if the trajectory node has no robot.description")
    parser.add_argument(
        "--velocity-scale", type=float, default=1.0, metavar="X", help="share of the largest velocity (default: 1)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object: duration, position, desired")


def execute(options: argparse.Namespace) -> int:
    from pidtsm_ros.client import Arm, ArmError, TargetError  # Only this command needs rclpy.

    _check(options)
    robot = read_arm(options)
    if robot is not None:
        robot.settings()  # Refused here if it cannot be used, before the system is looked for.
        robot.robot()
    introduce(options)
    try:
        with Arm(options.namespace, robot or "") as arm:
            try:
                duration = _begin(arm, options)
                if not options.json:
                    print(f"moving for {duration:.2f} s" + ("" if arm.uses_action else " (no action: by topic)"))
                begin = time.monotonic()
                arm.wait(10.0 + 2.0 * duration)
            except KeyboardInterrupt:
                arm.hold()
                raise
            except TargetError as error:
                raise UsageError(str(error)) from None
            state = arm.state
            result: dict[str, Any] = {
                "duration": duration,
                "wall_time": time.monotonic() - begin,
                "position": dict(zip(state.names, state.position.tolist(), strict=True)),
                "desired": dict(zip(state.names, state.desired[0].tolist(), strict=True)),
            }
    except ArmError as error:
        raise RunError(str(error)) from None
    if options.json:
        print(json.dumps(result))
    else:
        print("there: " + ", ".join(f"{name} {q:.4f}" for name, q in result["position"].items()))
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse what is wrong before the system is looked for."""
    if options.to:
        _target(options.to)
        if options.via or options.frame:
            raise UsageError("--via and --frame belong to --pose")
    elif len(options.pose) not in (3, 7):
        raise UsageError(f"--pose has {len(options.pose)} numbers: x y z, or x y z and a quaternion x y z w")
    elif options.velocity_scale != 1.0:
        raise UsageError("--velocity-scale belongs to --to; --speed limits the tool")


def _begin(arm: Any, options: argparse.Namespace) -> float:
    """Begin to move; returns the duration, s."""
    if options.to:
        return float(arm.move_to(_target(options.to), options.velocity_scale, wait=False))
    from pidtsm_core.poses.paths import Speed

    position, orientation = options.pose[:3], options.pose[3:] or None
    speed = Speed(velocity=options.speed)
    return float(arm.move_to_pose(position, orientation, options.via, options.frame, speed, wait=False))


def _target(words: list[str]) -> list[float] | dict[str, float]:
    """Positions, or positions by name."""
    try:
        if all("=" in word for word in words):
            return {name: float(q) for name, _, q in (word.partition("=") for word in words)}
        return [float(word) for word in words]
    except ValueError:
        raise UsageError(f"--to {' '.join(words)}: must be numbers, or JOINT=NUMBER for each") from None
