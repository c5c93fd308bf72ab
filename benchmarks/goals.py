"""Random goals of the action follow_joint_trajectory, with real nodes in lockstep: is any lost, late or rough?

Goals are sent at random times. Some are cancelled, some replaced while they run, some have bad content, and each must
end as it should. Meanwhile the torque and the reference are judged, sample by sample. The client passes every command
on to the arm, so that the time of the arm does not run ahead of the client.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_experiments.runs.runner import Processes, node_parameters
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.middleware import set_defaults
from pidtsm_ros.qos import LOCKSTEP_PUBLISHER, RECORDER
from pidtsm_ros.wire import IncomingMessages

NANOSECOND = 1e-9
_START = 0.5
"""Time for the controller to take over, s."""
_LARGEST = 0.4
"""Largest distance of a joint, rad or m."""
_WITHIN = 120.0
"""Wall time within which a goal must end; beyond it, it is lost, s."""
_ALLOWED = 1.2
"""Time until the result, as a share of the goal's duration: MoveIt's default allowance."""
_COMMANDS = "commands_of_the_controller"
_NODES = ("simulator", "controller", "trajectory")


@dataclass
class Judge:
    """The largest steps of the torque and of the reference's acceleration.

    Attributes:
        now: time of the last reference, s.
        reference: q_d, q_d', q_d'', shape (3, joints).
        torque_step: largest change of a torque in a sample, beyond that of the model along the reference, N m or N.
        jerk: largest jerk of the reference, as a share of the limit.
    """

    limits: MotionLimits
    now: float = -1.0
    torque_step: float = 0.0
    jerk: float = 0.0
    samples: int = 0
    _expected: dict[int, Array] = field(default_factory=dict)
    _beyond: Array | None = None

    def __post_init__(self) -> None:
        names = list(self.limits.joints)
        self.reference = np.zeros((3, len(names)))
        self._effort, self._model_effort = np.zeros((1, len(names))), np.zeros((1, len(names)))
        self._references = IncomingMessages(JointReference, ("position", "velocity", "acceleration"), names)
        self._commands = IncomingMessages(JointState, ("effort",), names)

    def on_reference(self, data: bytes) -> None:
        """Judge a reference, and compute the torque that it needs."""
        before, then = self.reference[2].copy(), self.now
        self._references.read(data, self.reference)
        stamp = serialized_nanoseconds(data)
        self.now = stamp * NANOSECOND
        if then >= 0.0 and self.now > max(then, _START):
            jerk = np.abs(self.reference[2] - before) / (self.now - then) / self.limits.jerk
            self.jerk = max(self.jerk, float(jerk.max()))
        q, dq, ddq = (row[self.limits.places] for row in self.reference)
        assert self.limits.model is not None
        inverse_dynamics(self.limits.model, q, dq, ddq[np.newaxis].copy(), self._model_effort)
        effort = np.empty_like(q)
        effort[self.limits.places] = self._model_effort[0]
        self._expected[stamp] = effort

    def on_command(self, data: bytes) -> None:
        """Judge a command; the reference with its stamp came before."""
        expected = self._expected.pop(stamp := serialized_nanoseconds(data), None)
        if expected is None:
            return
        self._commands.read(data, self._effort)
        beyond, before = self._effort[0] - expected, self._beyond
        self._beyond, self.samples = beyond, self.samples + 1
        if before is not None and stamp * NANOSECOND > _START:
            self.torque_step = max(self.torque_step, float(np.abs(beyond - before).max()))


class System:
    """The nodes of an arm, and a client."""

    def __init__(self, judge: Judge, node: Node) -> None:
        self.judge = judge
        self._executor = EventsExecutor(context=node.context)
        self._executor.add_node(node)
        self._client = ActionClient(node, FollowJointTrajectory, "trajectory/follow_joint_trajectory")
        self._commands = node.create_publisher(JointState, "joint_commands", LOCKSTEP_PUBLISHER)
        node.create_subscription(JointReference, "reference", judge.on_reference, RECORDER, raw=True)
        node.create_subscription(JointState, _COMMANDS, self._pass_on, RECORDER, raw=True)
        self.until(self._client.server_is_ready)

    def _pass_on(self, command: bytes) -> None:
        self.judge.on_command(command)
        self._commands.publish(command)

    def until(self, condition: Callable[[], Any]) -> bool:
        """Whether the condition holds in time."""
        end = time.monotonic() + _WITHIN
        while not condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        return bool(condition())

    def wait(self, duration: float) -> None:
        end = self.judge.now + duration
        self.until(lambda: self.judge.now >= end)

    def send(self, goal: Any) -> "Sent":
        future = self._client.send_goal_async(goal)
        began = self.judge.now
        if not self.until(future.done):
            sys.exit("the trajectory node does not answer")
        handle = future.result()
        return Sent(began, handle, handle.get_result_async() if handle.accepted else None)


@dataclass
class Sent:
    """A goal that was sent at time `began`, s; the result is None if it was rejected."""

    began: float
    handle: Any
    result: Any

    def done(self) -> bool:
        """Whether it was rejected or has a result."""
        return self.result is None or bool(self.result.done())

    @property
    def ended(self) -> str:
        """Status and error code; "lost" if there is no result."""
        if self.result is None:
            return "rejected"
        if not self.result.done():
            return "lost"
        answer = self.result.result()
        status = {GoalStatus.STATUS_SUCCEEDED: "succeeded", GoalStatus.STATUS_CANCELED: "cancelled"}
        return f"{status.get(answer.status, 'aborted')} {answer.result.error_code} {answer.result.error_string[:8]}"


def main() -> None:
    """Print what happened; exit code 1 if a goal was lost or ended otherwise than it should."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--goals", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robot", default="panda", help="an arm, or a file with its description")
    parser.add_argument("--payload", type=float, default=0.0, help="mass at the tool that the controller lacks, kg")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = soak(Path(folder), options.robot, options.payload, options.goals, options.seed)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print("\n".join(f"{name.replace('_', ' '):40}{value}" for name, value in found.items()))
    sys.exit(1 if found["lost"] or found["unexpected"] else 0)


def soak(folder: Path, robot: str, payload: float, goals: int, seed: int) -> dict[str, Any]:
    """Send goals; figures by name."""
    overrides = [f"simulator.payload.mass={payload}", f"trajectory.robot.description={robot}", "simulator.duration=0.0"]
    experiment = make_experiment(None, robot=robot, params=[PRACTICAL], overrides=overrides, duration=1.0)
    parameters = node_parameters(experiment, "lockstep")
    for node, subscribers in zip(_NODES, (2, 1, 1), strict=True):
        parameters[node]["start.subscribers"] = subscribers
    judge = Judge(motion_limits(parameters["trajectory"]))
    started = time.monotonic()
    with _running(folder, parameters) as node:
        system = System(judge, node)
        system.wait(_START)
        found = _send_all(system, goals, np.random.default_rng(seed))
    return found | {
        "largest_torque_step_beyond_the_model": round(judge.torque_step, 3),
        "largest_jerk_as_a_share_of_the_limit": round(judge.jerk, 3),
        "samples": judge.samples,
        "wall_time_s": round(time.monotonic() - started, 1),
    }


@contextmanager
def _running(folder: Path, parameters: dict[str, Any]) -> Iterator[Node]:
    """The nodes in one process of their own, and a node of ours."""
    set_defaults()
    here = patch.dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    with here, own_domain() as domain, Processes() as processes:
        words = ["-r", f"controller:joint_commands:={_COMMANDS}"]
        for name, values in parameters.items():
            file = folder / f"{name}.yaml"
            file.write_text(ros_parameters(name, values), encoding="utf-8")
            words += ["--params-file", str(file)]
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder)}
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        node = Node("goals", context=context)
        processes.start("composed", words, environment, folder / "composed.log")
        yield node
        node.destroy_node()
        context.try_shutdown()


_WANTED: dict[str, str | tuple[str, ...]] = {
    "good": "succeeded",
    "cancelled": "cancelled",
    "replaced": "aborted",
    "bad": ("aborted -1", "rejected"),
}
"""How goals should end; bad ones are rejected where joint_trajectory_controller rejects them."""


def _send_all(system: System, goals: int, random: np.random.Generator) -> dict[str, Any]:
    outcomes: Counter[str] = Counter()
    unexpected: list[str] = []
    ratios = [0.0]
    kinds = random.choice(["good", "cancelled", "replaced", "bad"], goals, p=[0.75, 0.1, 0.1, 0.05])
    ended = 0
    with suppress(KeyboardInterrupt):  # What was measured counts.
        for number, kind in enumerate(kinds):
            system.wait(random.uniform(0.0, 0.3))
            goal, duration = _goal(system.judge, random)
            sent = system.send(_spoilt(goal, random) if kind == "bad" else goal)
            wanted = _WANTED[kind]
            if kind == "cancelled":
                system.wait(random.uniform(0.1, 0.9) * duration)
                sent.handle.cancel_goal_async()
            if kind == "replaced":
                system.wait(random.uniform(0.1, 0.9) * duration)
                goal, duration = _goal(system.judge, random)
                first, sent = sent, system.send(goal)
                system.until(first.done)
                outcomes[first.ended] += 1
                if not first.ended.startswith("aborted -1 Current"):
                    unexpected.append(f"{number} ({kind}): {first.ended}")
                wanted = "succeeded"
            system.until(sent.done)
            outcomes[sent.ended] += 1
            if not sent.ended.startswith(wanted):
                text = sent.result.result().result.error_string if sent.result and sent.result.done() else ""
                unexpected.append(f"{number} ({kind}): {sent.ended} {text}")
            elif wanted == "succeeded":
                ratios.append((system.judge.now - sent.began) / duration)
                if ratios[-1] > _ALLOWED:
                    unexpected.append(
                        f"{number} ({kind}): took {ratios[-1]:.2f} times its duration of {duration:.2f} s"
                    )
            ended = number + 1
            print(f"\r{ended} of {goals} goals", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return {
        "goals": ended,
        "lost": outcomes["lost"],
        "outcomes": dict(outcomes),
        "unexpected": unexpected,
        "worst_duration_ratio": round(max(ratios), 3),
    }


def _goal(judge: Judge, random: np.random.Generator) -> tuple[Any, float]:
    """A goal that keeps the limits, and its duration, s; points with velocities, or positions only."""
    limits, (q, dq, _) = judge.limits, judge.reference
    lower, upper = np.maximum(limits.lower, q - math.pi), np.minimum(limits.upper, q + math.pi)
    margin = 0.1 * (upper - lower)
    target = np.clip(q + random.uniform(-_LARGEST, _LARGEST, q.size), lower + margin, upper - margin)
    way, moving = np.abs(target - q) + 0.5 * np.abs(dq), bool(dq.any())
    # Peaks of the quintic from rest to rest.
    times = (
        1.875 * way / limits.velocity,
        np.sqrt(5.77 * way / limits.acceleration),
        np.cbrt(60.0 * way / limits.jerk),
    )
    duration = float(np.max(times)) * random.uniform(1.3, 2.0) * (2.0 if moving else 1.0) + 0.2
    rest = np.zeros(q.size).tolist()
    message = JointTrajectory(joint_names=list(limits.joints))
    if moving or random.random() < 0.5:
        message.points = [_point(duration, positions=target.tolist(), velocities=rest, accelerations=rest)]
    else:
        duration *= 1.5
        shares = (0.35, 0.7, 1.0)
        message.points = [_point(s * duration, positions=(q + s * (target - q)).tolist()) for s in shares]
    return FollowJointTrajectory.Goal(trajectory=message), duration


def _point(t: float, **fields: list[float]) -> JointTrajectoryPoint:
    point = JointTrajectoryPoint(**fields)
    point.time_from_start.sec, point.time_from_start.nanosec = divmod(round(t * 1e9), 1_000_000_000)
    return point


def _spoilt(goal: Any, random: np.random.Generator) -> Any:
    """The goal with a mistake."""
    trajectory = goal.trajectory
    match random.integers(5):
        case 0:
            trajectory.points[-1].positions[0] = math.nan
        case 1:
            trajectory.joint_names[-1] = "nobody"
        case 2:
            trajectory.points[-1].positions.pop()
        case 3:
            trajectory.points.append(trajectory.points[0])
        case _:
            trajectory.points = []
    return goal


if __name__ == "__main__":
    main()
