"""Verdicts on the last seconds of a running loop, in a process of its own: reading and judging disturb nobody.

    python -m pidtsm_experiments.live.judge

The line of its input is a `Case`; each line of its output is a diagnosis, both as JSON. It ends with its input.
"""

import json
import os
import select
import sys
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.robots import DESCRIPTION, ROBOTS, Description
from pidtsm_core.signals import Fault, Mode, Signal
from pidtsm_experiments.commissioning.subjects import believed_arm
from pidtsm_experiments.live.stream import Batch, NumberStream, StateStream
from pidtsm_ros.security import prepare_process
from pidtsm_studies.diagnosis.diagnose import diagnose
from pidtsm_studies.diagnosis.observed import Observed
from pidtsm_studies.diagnosis.report import sentence, write_diagnosis_report
from pidtsm_studies.diagnosis.results import as_json

SPAN, _SHORTEST = 20.0, 6.0
"""s that are judged, and s that are awaited before the first verdict."""
_EVERY, _SHARE = 3.0, 4.0
"""s between two judgements, and at least this multiple of the time that one takes."""
_DEPTH = 20_000
"""Messages that wait while the last seconds are judged."""
_TAKE = 0.1  # s
_JOINT_STATE = ("position", "velocity", "effort")
_POSITION, _EFFORT = 0, 2
_NICE = 10


@dataclass(frozen=True)
class Case:
    """What is judged.

    Attributes:
        values: parameters of the controller.
        page: HTML file for the evidence.
        namespace: of the topics.
        words: arguments of ROS.
    """

    values: Mapping[str, Any]
    page: str
    namespace: str = ""
    words: list[str] = field(default_factory=list)

    def line(self) -> str:
        """The case as `judge` reads it."""
        return json.dumps(asdict(self), allow_nan=False)


class Window:
    """The last seconds of joint states, and of the controller's states, which answer them."""

    def __init__(self, span: float = SPAN) -> None:
        """Args: span: s."""
        self._span = round(1e9 * span)
        self._measured: deque[Batch] = deque()
        self._answered: deque[Batch] = deque()

    def add(self, measured: Batch | None, answered: Batch | None) -> None:
        """Add what has arrived; values of joint states are those of `joint_states`, those of answers are `Signal`."""
        for batches, new in ((self._measured, measured), (self._answered, answered)):
            if new is None:
                continue
            if batches and (batches[-1].stamps[-1] > new.stamps[0] or batches[-1].newest.name != new.newest.name):
                batches.clear()  # The clock was set, or this is another arm.
            batches.append(new)
            while new.stamps[-1] - batches[0].stamps[-1] > self._span:
                batches.popleft()

    @property
    def duration(self) -> float:
        """s from the first to the last joint state that the controller answered."""
        return float(1e-9 * (self._answered[-1].stamps[-1] - self._answered[0].stamps[0])) if self._answered else 0.0

    def observed(self, slides: tuple[bool, ...] = ()) -> Observed | None:
        """What a recorder would have seen; None: there are no joint states with the controller's joints.

        Args:
            slides: whether each joint slides.
        """
        if not self._measured or not self._answered:
            return None
        joints, newest = list(self._answered[-1].newest.name), self._answered[-1].newest
        names = list(self._measured[-1].newest.name)
        if not set(joints) <= set(names):
            return None
        begin = max(self._measured[0].stamps[0], self._answered[0].stamps[0])
        end = min(self._measured[-1].stamps[-1], self._answered[-1].stamps[-1])
        known, seen = _joined(self._measured)
        asked, said = _joined(self._answered)
        stamps = np.union1d(known, asked)
        stamps = stamps[(stamps >= begin) & (stamps <= end)]
        seen = _at(stamps, known, seen[:, :, [names.index(joint) for joint in joints]])
        said = _at(stamps, asked, said)
        mode = np.repeat([each.newest.mode for each in self._answered], [len(each.stamps) for each in self._answered])
        command, effort = said[:, Signal.EFFORT], seen[:, _EFFORT]
        reported = bool(np.isfinite(effort).any())
        return Observed(
            joints=tuple(joints),
            time=(stamps - stamps[0]) / 1e9,
            position=seen[:, _POSITION],
            # What was commanded acts from the stamp on; reports are of the time before.
            effort=effort if reported else np.vstack([command[:1], command[:-1]]),
            command=command,
            reference=said[:, Signal.POSITION] - said[:, Signal.POSITION_ERROR],
            following=mode[np.clip(np.searchsorted(asked, stamps), 0, mode.size - 1)] == Mode.FOLLOWING,
            slides=slides,
            stopped=Fault(newest.fault).name.lower().replace("_", " ") if newest.fault else "",
            effort_is_command=not reported,
        )


def _joined(batches: deque[Batch]) -> tuple[NDArray[np.int64], Array]:
    """Stamps and values of all batches, each stamp once."""
    stamps, rows = np.unique(np.concatenate([each.stamps for each in batches]), return_index=True)
    return stamps, np.concatenate([each.values for each in batches])[rows]


def _at(stamps: NDArray[np.int64], known: NDArray[np.int64], values: Array) -> Array:
    """Values at stamps; nan where there are none."""
    found = np.full((stamps.size, *values.shape[1:]), np.nan)
    rows = np.minimum(np.searchsorted(known, stamps), known.size - 1)
    there = known[rows] == stamps
    found[there] = values[rows[there]]
    return found


def judged_arm(values: Mapping[str, Any]) -> tuple[Description | None, str]:
    """What the controller believes of its arm, and what ``--robot`` names it; None: the model cannot be judged."""
    source = str(values.get(DESCRIPTION.name, ""))
    if not source or source in ROBOTS:  # Closed forms have no links whose masses could be free.
        return None, "ROBOT"
    return believed_arm(values), "ROBOT" if "<" in source else source


def judge(window: Window, arm: Description | None, robot: str, page: Path) -> dict[str, Any]:
    """The diagnosis of a window as plain data, with its sentence; the evidence is in the page."""
    observed = window.observed(tuple(arm.slides) if arm is not None else ())
    if observed is None:
        return {"refused": "no joint_states with the joints of the controller"}
    try:
        found = diagnose(observed, arm, robot)
    except UsageError as error:
        return {"refused": str(error)}
    write_diagnosis_report(page, found, "the running loop")
    return {**as_json(found), "sentence": sentence(found)}


def joint_states(node: Node) -> NumberStream:
    """A subscription to positions, velocities and efforts."""
    return NumberStream(node, JointState, "joint_states", _JOINT_STATE, _DEPTH, optional=_JOINT_STATE[1:])


def main() -> None:
    """Run the process."""
    case = Case(**json.loads(sys.stdin.readline()))
    os.nice(_NICE)
    arguments = ["judge", *(["--ros-args", *case.words] if case.words else [])]
    rclpy.init(args=prepare_process(arguments))
    node = Node("judge", namespace=case.namespace, enable_rosout=False)
    states = StateStream(node, _DEPTH)
    measured = joint_states(node)
    window, due, fresh = Window(), 0.0, False
    arm, robot = judged_arm(case.values)
    while not select.select([sys.stdin], [], [], _TAKE)[0]:
        answered = states.take()
        window.add(measured.take(), answered)
        fresh = fresh or answered is not None
        if fresh and window.duration >= _SHORTEST and time.monotonic() > due:
            begun, fresh = time.monotonic(), False
            print(json.dumps(judge(window, arm, robot, Path(case.page)), allow_nan=False), flush=True)
            due = time.monotonic() + max(_EVERY, _SHARE * (time.monotonic() - begun))
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
