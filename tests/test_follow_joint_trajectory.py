"""The action follow_joint_trajectory: the real node and rclpy's action client; the test is the arm and its clock."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointComponentTolerance, JointTolerance
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from numpy.typing import NDArray
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from support.testarms import TURNTABLE
from support.testbed import Testbed, open_testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from pidtsm_core.experiment.node_parameters import trajectory_node_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.stopping import stop
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.stamps import nanoseconds, set_stamp

Vector = NDArray[np.float64]
Result = FollowJointTrajectory.Result
NAMES = ["joint1", "joint2"]
PERIOD = 0.004
SOON = 25 * PERIOD
"""s of the arm; a result is on its way for some periods, during which the arm goes on."""
REST = [0.0, 0.0]
SETTINGS = {"joints": NAMES, "robot.description": TURNTABLE, "reference.name": "sines"}
LIMITS: MotionLimits = motion_limits(resolve(trajectory_node_schema, SETTINGS, 2))
NAN = math.nan
REJECTED = -1
"""Stands for the status of a goal that was rejected, and has none."""
STORM = 300
"""Number of goals; once, 10,000 were tried."""
PAGE = Path(__file__).resolve().parents[1] / "docs" / "moveit.md"
CANCELS = 4
"""Number of random moments; once, 50 were tried."""


def duration(t: float) -> Duration:
    return Duration(sec=math.floor(t), nanosec=round((t - math.floor(t)) * 1e9))


def point(t: float, *fields: list[float], effort: list[float] | None = None) -> JointTrajectoryPoint:
    names = ("positions", "velocities", "accelerations")
    given = dict(zip(names, fields, strict=False))
    return JointTrajectoryPoint(time_from_start=duration(t), **given, effort=effort or [])


def goal(*points: JointTrajectoryPoint, names: list[str] = NAMES, start: float = 0.0, **others: Any) -> Any:
    made = FollowJointTrajectory.Goal(**others)
    made.trajectory = JointTrajectory(joint_names=names, points=points)
    set_stamp(made.trajectory.header.stamp, round(start * 1e9))
    return made


def to(q: list[float], t: float = 1.0, **others: Any) -> Any:
    """A goal with one point, at rest."""
    return goal(point(t, q, REST), **others)


SUCCESS = (GoalStatus.STATUS_SUCCEEDED, Result.SUCCESSFUL, "Goal successfully reached!")


class Sent:
    """A goal that was sent, and what came back."""

    def __init__(self, rig: "Rig", content: Any) -> None:
        self.feedback: list[FollowJointTrajectory.Feedback] = []
        log, before = rig.process.log, len(rig.process.log.read_text())
        self._future = rig.client.send_goal_async(content, lambda message: self.feedback.append(message.feedback))
        rig.testbed.spin_until(self._future.done, "the response to a goal")
        self.handle = self._future.result()
        self.done: Callable[[], bool] = lambda: True
        if self.handle.accepted:
            self._result = self.handle.get_result_async()
            self.done = self._result.done
        else:
            rig.testbed.spin_until(lambda: "goal rejected: " in log.read_text()[before:], "the reason")
            self._reason = log.read_text()[before:].partition("goal rejected: ")[2].partition("\n")[0]

    @property
    def outcome(self) -> tuple[int, int, str]:
        """Status, error code, text; of a goal that was rejected the reason in the log."""
        if not self.handle.accepted:
            return REJECTED, 0, self._reason
        answer = self._result.result()
        return answer.status, answer.result.error_code, answer.result.error_string


class Rig:
    """A trajectory node whose time is what the test says it is.

    Attributes:
        t: s.
        reference: q_d, q_d', q_d'', effort at that time, shape (4, joints).
        offset: of the arm from its reference, rad.
        path: time and reference of all samples, shape (samples, 1 + 4 joints).
    """

    def __init__(self, testbed: Testbed) -> None:
        self.testbed, node = testbed, testbed.node
        self.references: list[JointReference] = []
        self.joint_states = node.create_publisher(JointState, "joint_states", 10)
        self.trajectories = node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.controller = node.create_publisher(ControllerState, "controller/state", 10)
        node.create_subscription(JointReference, "reference", self.references.append, 10)
        parameters = [f"{name}:={value}" for name, value in SETTINGS.items() if name != "joints"]
        self.process = testbed.start("trajectory", *parameters, "clock:=lockstep")
        self.client = ActionClient(node, FollowJointTrajectory, "trajectory/follow_joint_trajectory")
        testbed.spin_until(self._connected, "the trajectory node")
        self.t, self.offset = 1.0, np.zeros(2)
        self.reference = np.zeros((4, 2))
        self._path: list[Vector] = []
        self.wait_for_server()

    def _connected(self) -> bool:
        publishers = (self.joint_states, self.trajectories, self.controller)
        return all(p.get_subscription_count() for p in publishers) and bool(
            self.testbed.node.count_publishers("reference")
        )

    def wait_for_server(self) -> None:
        self.testbed.spin_until(self.client.server_is_ready, "the action")

    @property
    def path(self) -> Vector:
        return np.array(self._path)

    def step(self, dt: float = PERIOD) -> None:
        """A joint state, and the reference that answers it."""
        self.t += dt
        message = JointState(name=NAMES, position=(self.reference[0] + self.offset).tolist())
        set_stamp(message.header.stamp, round(self.t * 1e9))
        before = len(self.references)
        self.joint_states.publish(message)
        self.testbed.spin_until(lambda: len(self.references) > before, f"the reference at {self.t} s")
        answer = self.references[-1]
        assert answer.header.stamp == message.header.stamp
        self.reference = np.array([answer.position, answer.velocity, answer.acceleration, answer.effort])
        self._path.append(np.concatenate([[self.t], *self.reference]))

    def until(self, condition: Callable[[], Any], longest: float = 20.0) -> None:
        """Time goes on until the condition holds."""
        end = self.t + longest
        while not condition():
            assert self.t < end, f"not within {longest:g} s"
            self.step()

    def follow(self, *, seconds: float) -> None:
        end = self.t + seconds
        self.until(lambda: self.t >= end)

    def finish(self, content: Any) -> Sent:
        """Send a goal, and go on until it has ended."""
        sent = Sent(self, content)
        self.until(sent.done)
        return sent

    def begin(self, content: Any) -> Sent:
        """Send a goal, and go on until its motion has begun."""
        sent = Sent(self, content)
        self.until(lambda: sent.feedback)
        return sent

    def rest(self, q: list[float] | None = None) -> None:
        """Come to rest, at q if given."""
        self.offset[:] = 0.0
        self.report(ControllerState.FOLLOWING)
        before = self.process.log.read_text().count("coming to rest")
        self.trajectories.publish(JointTrajectory())
        self.testbed.spin_until(lambda: self.process.log.read_text().count("coming to rest") > before, "a stop")
        self.until(lambda: not self.reference[1:].any())
        if q is not None:
            assert self.finish(to(q)).outcome == SUCCESS
        self._path.clear()

    def home(self) -> None:
        """Come to rest at 0, if the reference is elsewhere."""
        if np.abs(self.reference[0]).max() > 1e-6:
            self.rest([0.0, 0.0])

    def report(self, mode: int, fault: int = ControllerState.NO_FAULT, joint: int = 0) -> None:
        """The mode of the controller."""
        state = ControllerState(name=NAMES, mode=mode, fault=fault, fault_joint=joint)
        set_stamp(state.header.stamp, round(self.t * 1e9))
        self.controller.publish(state)
        self.follow(seconds=0.04)

    def check_smooth(self) -> None:
        """The reference makes no step in position or velocity: each follows from its derivative."""
        t, q, dq, ddq = self.path[:, 0], self.path[:, 1:3], self.path[:, 3:5], self.path[:, 5:7]
        dt = np.diff(t)[:, np.newaxis]
        np.testing.assert_allclose(np.diff(q, axis=0), dt * (dq[1:] + dq[:-1]) / 2.0, atol=2e-5)
        assert np.abs(np.diff(dq, axis=0)).max() <= PERIOD * (np.abs(ddq).max() * 1.5 + 1.0)


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with open_testbed(tmp_path_factory.mktemp("action")) as testbed:
        yield Rig(testbed)


@pytest.fixture
def rig(system: Rig) -> Rig:
    if system.t == 1.0:
        system.step()
    system.rest()
    return system


def aborted(code: int, *texts: str) -> Callable[[tuple[int, int, str]], None]:
    def check(outcome: tuple[int, int, str]) -> None:
        assert outcome[:2] == (GoalStatus.STATUS_ABORTED, code), outcome
        for text in texts:
            assert text in outcome[2]

    return check


def test_a_goal_succeeds_when_the_arm_is_there_and_feedback_tells_where_it_is(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    began = rig.t
    rig.offset[:] = [0.02, -0.04]
    sent = Sent(rig, to([0.4, -0.3]))
    rig.follow(seconds=1.3)
    np.testing.assert_allclose(rig.reference[0], [0.4, -0.3])
    assert not sent.done(), "the reference is there, joint2 is not"
    rig.offset[:] = [0.02, -0.02]
    rig.until(sent.done)
    assert sent.outcome == SUCCESS
    assert rig.t > began + 1.31
    rig.check_smooth()

    times = np.array([nanoseconds(message.header.stamp) / 1e9 for message in sent.feedback])
    np.testing.assert_allclose(np.diff(times), 0.05, atol=PERIOD)
    middle = sent.feedback[8]
    assert list(middle.joint_names) == NAMES
    np.testing.assert_allclose(np.subtract(middle.desired.positions, middle.actual.positions), middle.error.positions)
    np.testing.assert_allclose(middle.error.positions, [-0.02, 0.04], atol=0.01)
    assert all(len(getattr(middle.desired, field)) == 2 for field in ("velocities", "accelerations", "effort"))
    np.testing.assert_allclose(
        np.subtract(middle.desired.velocities, middle.actual.velocities), middle.error.velocities
    )
    assert middle.desired.time_from_start.nanosec == pytest.approx(4e8, abs=1.5e7)


GOOD = point(1.0, [0.1, 0.2], REST)
LAST = point(2.0, [0.2, 0.2], REST)


class Case(NamedTuple):
    """A goal, by its name in docs/moveit.md, and what the node answers.

    Attributes:
        content: the goal; or what is done with a goal, and returns the one whose outcome counts.
        answer: the words of the page.
        text: in the result, or in the log if the goal is rejected.
        offset: of the arm from the reference, rad.
        partial: whether joints may be missing.
    """

    content: Any
    answer: str
    text: str = ""
    offset: float = 0.0
    partial: bool = False


def others(field: str, *values: Any) -> Any:
    """A goal with something in another field than the points of its joints."""
    made = to([0.05, 0.05], 0.4)
    target = made
    *path, name = field.split(".")
    for each in path:
        target = getattr(target, each)
    setattr(target, name, list(values))
    return made


def here(rig: "Rig") -> Sent:
    """One point at time 0 where the arm is, which is not quite where the reference is; the arm is there at once."""
    sent, before = Sent(rig, goal(point(0.0, (rig.reference[0] + rig.offset).tolist()))), rig.t
    rig.until(sent.done)
    assert rig.t - before < SOON, "at once, but for the way of the messages"
    return sent


def a_second_goal(rig: "Rig") -> Sent:
    first = rig.begin(to([0.3, 0.3]))
    assert rig.finish(to([0.0, 0.0], 0.5)).outcome == SUCCESS
    return first


def cancelled(rig: "Rig") -> Sent:
    sent = rig.begin(to([0.3, 0.3]))
    response = sent.handle.cancel_goal_async()
    rig.testbed.spin_until(response.done, "the response")
    return sent


def cancelled_late(rig: "Rig") -> Sent:
    sent = rig.finish(to([0.05, 0.05], 0.4))
    response = sent.handle.cancel_goal_async()
    rig.testbed.spin_until(response.done, "the response")
    assert response.result().return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
    assert not response.result().goals_canceling
    return sent


def deactivated(rig: "Rig") -> Sent:
    sent = rig.begin(to([0.3, 0.3]))
    change_state(rig, Transition.TRANSITION_DEACTIVATE)
    rig.testbed.spin_until(sent.done, "the result")
    change_state(rig, Transition.TRANSITION_ACTIVATE)
    rig.step()
    return sent


def to_an_inactive_node(rig: "Rig") -> Sent:
    change_state(rig, Transition.TRANSITION_DEACTIVATE)
    sent = Sent(rig, to([0.1, 0.1]))
    change_state(rig, Transition.TRANSITION_ACTIVATE)
    rig.step()
    return sent


def started(*points: JointTrajectoryPoint, ago: float) -> Callable[["Rig"], Sent]:
    """A goal whose stamp is so long ago, s."""
    return lambda rig: Sent(rig, goal(*points, start=rig.t - ago))


TABLE = {
    # Rejected here and there.
    "unknown joint": Case(goal(GOOD, names=["joint1", "hand"]), "rejected", "unknown joints hand"),
    "missing joint": Case(goal(point(1.0, [0.1]), names=["joint1"]), "rejected", "joints joint2 are missing"),
    "more names than joints": Case(goal(GOOD, names=[*NAMES, "joint1"]), "rejected", "3 names for 2 joints"),
    "no names": Case(goal(GOOD, names=[]), "rejected", "joints joint1, joint2 are missing"),
    "no points": Case(goal(), "rejected", "no points"),
    "equal times": Case(goal(GOOD, GOOD), "rejected", "increase from point to point"),
    "times that decrease": Case(goal(LAST, GOOD), "rejected", "1 s of point 2 comes after 2 s"),
    "too few or too many positions": Case(
        goal(point(1.0, [0.1])), "rejected", "positions of point 1 has 1 values for 2 joints"
    ),
    "too few or too many velocities": Case(
        goal(GOOD, point(2.0, REST, [0.0, 0.0, 0.0])), "rejected", "velocities of point 2 has 3 values"
    ),
    "too few or too many accelerations": Case(
        goal(point(1.0, REST, REST, [0.0])), "rejected", "accelerations of point 1 has 1 values"
    ),
    "velocities alone": Case(goal(point(1.0, [], REST)), "rejected", "positions of point 1 has 0 values"),
    "an empty point": Case(goal(GOOD, point(2.0)), "rejected", "positions of point 2 has 0 values"),
    "a last point that moves": Case(
        goal(point(1.0, REST, [0.1, 0.0])), "rejected", "must end at rest; the last point has 0.1 as velocity of joint1"
    ),
    "stamp in the past, and over": Case(started(GOOD, ago=1.5), "rejected", "it ended 0.500 s ago"),
    "node not active": Case(to_an_inactive_node, "rejected", "activate it first"),
    # Accepted here and there.
    "stamp 0": Case(to([0.05, 0.05], 0.4), "succeeded"),
    "stamp in the future": Case(lambda rig: Sent(rig, to([0.05, 0.05], 0.4, start=rig.t + 0.3)), "succeeded"),
    "stamp in the past, no point due yet": Case(started(GOOD, ago=0.2), "succeeded"),
    "stamp in the past, last due point far away": Case(
        started(point(0.1, [0.9, 0.9], REST), GOOD, ago=0.3), "aborted -4", "point 1 is due now, and 0.9"
    ),
    "one point at time 0 where the arm is": Case(here, "succeeded", offset=0.004),
    "one point at time 0 elsewhere": Case(goal(point(0.0, [0.5, 0.0])), "aborted -4", "start_tolerance"),
    "joints in another order": Case(goal(point(0.4, [0.05, 0.02]), names=["joint2", "joint1"]), "succeeded"),
    "some of the joints, with `allow_partial_joints_goal`": Case(
        goal(point(0.4, [0.05]), names=["joint2"]), "succeeded", partial=True
    ),
    "efforts (effort interface)": Case(goal(point(0.4, [0.05, 0.05], effort=[0.5, 0.0])), "succeeded"),
    "path tolerance exceeded": Case(
        to([0.2, 0.2], 0.8), "aborted -4", "joint2: position error 0.06 exceeds the tolerance 0.05", offset=0.06
    ),
    "goal tolerance exceeded for `goal_time_tolerance`": Case(
        to([0.1, 0.1], 0.5, goal_time_tolerance=duration(0.2)), "aborted -5", "tolerance 0.03 at the goal", offset=0.04
    ),
    "goal tolerance exceeded, but it is -1": Case(
        to([0.1, 0.1], 0.5, goal_tolerance=[JointTolerance(name="joint2", position=-1.0)]), "succeeded", offset=0.04
    ),
    "a second goal while one runs: the first": Case(a_second_goal, "aborted -1", "replaced by a new goal at"),
    "cancelled": Case(cancelled, "canceled 0", "the reference is at rest"),
    "cancelled after its end": Case(cancelled_late, "succeeded"),
    "node deactivated while it runs": Case(deactivated, "aborted -1", "during deactivate transition"),
    # Accepted there.
    "a joint twice": Case(goal(GOOD, names=["joint1", "joint1"]), "aborted -2", "named twice"),
    "not a number, infinite": Case(
        goal(point(1.0, [NAN, 0.0])), "aborted -1", "positions of point 1 is not finite: joint1"
    ),
    "first time negative": Case(goal(point(-1.0, REST, REST), GOOD), "aborted -1", "time_from_start must begin at 0"),
    "points with different fields": Case(
        goal(point(0.5, REST), GOOD), "aborted -1", "point 2 has positions, velocities; the first has positions"
    ),
    "positions and accelerations alone": Case(
        goal(point(1.0, REST, [], REST)), "aborted -1", "a point has positions, accelerations; it needs"
    ),
    "too few or too many efforts": Case(
        goal(point(1.0, REST, effort=[1.0])), "aborted -1", "effort of point 1 has 1 values"
    ),
    "beyond a limit of the arm": Case(to([3.0, 0.0], 1.0), "aborted -1", "joint1"),
    "more than 50,000 points": Case(lambda rig: Sent(rig, goal(*([GOOD] * 50_001))), "aborted -1", "at most 50000"),
    "longer than an hour": Case(goal(point(1e5, REST)), "aborted -1", "at most 3600 s"),
    "tolerance of an unknown joint": Case(
        others("path_tolerance", JointTolerance(name="hand")), "aborted -2", "path_tolerance: unknown joint hand"
    ),
    "negative tolerance, not -1": Case(
        others("goal_tolerance", JointTolerance(name="joint1", velocity=-2.0)), "aborted -1", "velocity is -2"
    ),
    "tolerance of an acceleration": Case(
        others("path_tolerance", JointTolerance(name="joint1", acceleration=1.0)), "aborted -1", "are not measured"
    ),
    "several degrees of freedom": Case(
        others("multi_dof_trajectory.points", MultiDOFJointTrajectoryPoint()), "aborted -1", "several degrees"
    ),
}
"""The goals of the page."""
STATUS = {
    "rejected": REJECTED,
    "succeeded": GoalStatus.STATUS_SUCCEEDED,
    "aborted": GoalStatus.STATUS_ABORTED,
    "canceled": GoalStatus.STATUS_CANCELED,
}
JTC_TEXTS = {
    "succeeded": "Goal successfully reached!",
    "aborted -4": "Aborted due to path tolerance violation",
    "aborted -5": "Aborted due to goal_time_tolerance exceeding by 0.2",
    "a second goal while one runs: the first": "Current goal preempted by new incoming action",
    "node deactivated while it runs": "Current goal cancelled during deactivate transition",
}
"""How the texts of joint_trajectory_controller begin."""


@pytest.mark.parametrize("name", TABLE)
def test_goals_are_answered_as_the_page_says(rig: Rig, name: str) -> None:
    case = TABLE[name]
    rig.home()
    rig.offset[1] = case.offset
    if case.partial:
        rig.testbed.set("trajectory", {"allow_partial_joints_goal": True})
    sent = case.content(rig) if callable(case.content) else Sent(rig, case.content)
    rig.until(sent.done)
    if case.partial:
        rig.testbed.set("trajectory", {"allow_partial_joints_goal": False})
    word, _, code = case.answer.partition(" ")
    assert sent.outcome[:2] == (STATUS[word], int(code or 0)), sent.outcome
    assert case.text in sent.outcome[2]
    assert sent.outcome[2].startswith(JTC_TEXTS.get(name, JTC_TEXTS.get(case.answer, ""))), sent.outcome


def test_the_page_has_every_goal_and_its_answer() -> None:
    section = PAGE.read_text(encoding="utf-8").partition("\n## The answer to each goal\n")[2].partition("\n## ")[0]
    alike, different = ([cells(line) for line in table.splitlines()[2:]] for table in tables(section))
    answers = {name: answer for answer, names in alike for name in names.split("; ")}
    answers |= {name: answer for name, answer, _ in different}
    assert answers == {name: case.answer for name, case in TABLE.items()}
    assert all(reason for *_, reason in different), "each difference has a reason"


def tables(text: str) -> list[str]:
    """The tables of a text in Markdown."""
    return [part for part in text.split("\n\n") if part.lstrip().startswith("|")]


def cells(line: str) -> list[str]:
    """Of a row of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def test_a_bad_goal_leaves_the_running_one_alone(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    running = rig.begin(to([0.2, 0.2], 3.0))
    plain = [case for case in TABLE.values() if not callable(case.content) and not case.offset]
    bad = [case.content for case in plain if case.answer != "succeeded"]
    sent = [Sent(rig, content) for content in bad]
    rig.until(lambda: all(each.done() for each in sent))
    assert not running.done()
    assert GoalStatus.STATUS_SUCCEEDED not in {each.outcome[0] for each in sent}
    rig.until(running.done)
    assert running.outcome == SUCCESS
    rig.check_smooth()


CONTENTS = {
    "NaN effort": (goal(point(1.0, REST, effort=[NAN, 0.0])), Result.INVALID_GOAL, "effort of point 1 is not finite"),
    "position limit": (to([0.0, 1.2], 4.0), Result.INVALID_GOAL, "joint2"),
    "effort limit": (to([0.4, 0.0], 0.1), Result.INVALID_GOAL, "joint1"),
    "NaN tolerance": (
        to(REST, path_tolerance=[JointTolerance(name="joint1", position=NAN)]),
        Result.INVALID_GOAL,
        "position is nan",
    ),
    "component": (to(REST, component_path_tolerance=[JointComponentTolerance()]), Result.INVALID_GOAL, "degrees"),
}


@pytest.mark.parametrize("name", CONTENTS)
def test_goals_that_cannot_be_followed_are_aborted_with_the_reason(rig: Rig, name: str) -> None:
    content, code, text = CONTENTS[name]
    rig.home()
    aborted(code, text)(rig.finish(content).outcome)


NONE = [JointTolerance(name=name, position=-1.0, velocity=-1.0) for name in NAMES]


@pytest.mark.parametrize(
    ("offset", "others", "code", "texts"),
    [
        (0.06, {}, Result.PATH_TOLERANCE_VIOLATED, ("joint2: position error 0.06 exceeds the tolerance 0.05", "after")),
        (
            0.02,
            {"path_tolerance": [JointTolerance(name="joint2", position=0.01)]},
            Result.PATH_TOLERANCE_VIOLATED,
            ("joint2: position error 0.02 exceeds the tolerance 0.01",),
        ),
        (
            0.06,
            {"path_tolerance": NONE},
            Result.GOAL_TOLERANCE_VIOLATED,
            ("joint2: position error 0.06 exceeds the tolerance 0.03 at the goal", "goal_time_tolerance (1 s)"),
        ),
        (
            0.04,
            {"goal_time_tolerance": duration(0.2)},
            Result.GOAL_TOLERANCE_VIOLATED,
            ("exceeding by 0.20", "exceeds the tolerance 0.03 at the goal", "goal_time_tolerance (0.2 s)"),
        ),
        (0.06, {"path_tolerance": NONE, "goal_tolerance": NONE}, Result.SUCCESSFUL, ("",)),
        (0.06, {"path_tolerance": NONE, "goal_time_tolerance": Duration(sec=-1)}, None, ()),
    ],
    ids=["path", "path of the goal", "goal", "goal time", "none", "no goal time"],
)
def test_tolerances(rig: Rig, offset: float, others: dict[str, Any], code: int | None, texts: tuple[str, ...]) -> None:
    rig.rest([0.0, 0.0])
    rig.offset[1] = offset
    sent = Sent(rig, to([0.2, 0.2], 0.8, **others))
    if code is None:
        rig.follow(seconds=3.0)
        assert not sent.done(), "it may take any time"
        rig.offset[1] = 0.0
    rig.until(sent.done)
    if code:
        aborted(code, *texts)(sent.outcome)
    else:
        assert sent.outcome == SUCCESS
    rig.until(lambda: not rig.reference[1:].any())
    rig.check_smooth()


def test_a_goal_of_many_points_is_followed_like_one_of_few(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    points = []
    for x in np.arange(1, 5001) / 5000:
        q = x**3 * (10.0 - x * (15.0 - 6.0 * x))
        dq, ddq = x**2 * (30.0 - x * (60.0 - 30.0 * x)), x * (60.0 - x * (180.0 - 120.0 * x))
        points.append(point(x, *([0.2 * value, 0.0] for value in (q, dq, ddq))))
    assert rig.finish(goal(*points)).outcome == SUCCESS
    t, q = rig.path[:, 0], rig.path[:, 1]
    half = int(np.searchsorted(q, 0.1))
    middle = np.interp(0.1, q[half - 1 : half + 1], t[half - 1 : half + 1])
    x = np.clip(t - (middle - 0.5), 0.0, 1.0)
    np.testing.assert_allclose(q, 0.2 * x**3 * (10.0 - x * (15.0 - 6.0 * x)), atol=1e-4)
    np.testing.assert_allclose(rig.reference[0], [0.2, 0.0], atol=1e-12)
    rig.check_smooth()


def test_a_new_goal_replaces_the_running_one_smoothly_and_the_old_one_is_told(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    first = rig.begin(to([0.5, 0.5]))
    rig.follow(seconds=0.3)
    second = rig.finish(to([-0.2, 0.1]))
    aborted(Result.INVALID_GOAL, "replaced by a new goal at")(first.outcome)
    assert second.outcome == SUCCESS
    rig.check_smooth()


def test_a_goal_begins_at_its_stamp_and_one_of_the_past_is_joined(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    running = rig.begin(to([0.2, 0.0], 2.0))
    start = rig.t + 0.8
    dropped = Sent(rig, to([0.5, 0.5], start=start))
    waiting = Sent(rig, to([0.0, 0.2], start=start))
    rig.follow(seconds=0.7)
    aborted(Result.INVALID_GOAL, "replaced by a new goal before its start")(dropped.outcome)
    assert not running.done()
    rig.until(running.done)
    assert start <= rig.t <= start + 4.0 * PERIOD
    rig.until(waiting.done)
    assert waiting.outcome == SUCCESS
    assert rig.t == pytest.approx(start + 1.0, abs=0.1)
    rig.check_smooth()

    rig.rest([0.0, 0.0])
    start = rig.t - 0.5
    sent = rig.finish(goal(point(0.0, REST), point(4.0, [0.1, 0.1]), start=start))
    assert sent.outcome == SUCCESS
    assert rig.t == pytest.approx(start + 4.0, abs=0.1)
    rig.check_smooth()


@pytest.mark.parametrize("moment", np.random.default_rng(1).uniform(0.0, 1.0, CANCELS).round(3))
def test_a_cancelled_goal_comes_to_rest_within_the_limits(rig: Rig, moment: float) -> None:
    rig.rest([0.0, 0.0])
    sent = rig.begin(goal(point(0.5, [0.4, -0.2]), point(1.1, [0.8, -0.5])))
    rig.follow(seconds=moment)
    cancelled = sent.handle.cancel_goal_async()
    rig.testbed.spin_until(cancelled.done, "the response")
    rig.step()
    began, shortest, last = rig.t, stop(rig.reference[:3], LIMITS), np.empty((3, 2))
    shortest.evaluate(shortest.end, last)
    rig.until(sent.done)
    assert sent.outcome[:2] == (GoalStatus.STATUS_CANCELED, Result.SUCCESSFUL)
    assert not rig.reference[1:].any()
    assert rig.t - began <= shortest.end + 0.05
    np.testing.assert_allclose(rig.reference[0], last[0], atol=0.01)
    rig.check_smooth()


def test_the_rest_holds_still_in_a_partial_goal(rig: Rig) -> None:
    rig.rest([0.1, 0.2])
    content = goal(point(0.5, [0.3], [0.0]), names=["joint2"])
    rig.testbed.set("trajectory", {"allow_partial_joints_goal": True})
    assert rig.finish(content).outcome == SUCCESS
    rig.testbed.set("trajectory", {"allow_partial_joints_goal": False})
    np.testing.assert_allclose(rig.reference[0], [0.1, 0.3])
    np.testing.assert_allclose(rig.path[:, 1], 0.1, atol=1e-12)


def test_a_joint_that_turns_without_end_takes_the_nearest_turn(rig: Rig) -> None:
    rig.rest([0.1, 0.0])
    assert rig.finish(goal(point(1.0, [0.3 - 2.0 * math.tau, 0.0]))).outcome == SUCCESS
    np.testing.assert_allclose(rig.reference[0], [0.3, 0.0], atol=1e-12)
    rig.offset[0] = math.tau
    assert rig.finish(to([0.1, 0.0])).outcome == SUCCESS, "where it is measured does not matter either"


def test_efforts_are_fed_forward_without_steps(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    points = [point(0.4, [0.1, 0.1], effort=[2.0, -1.0]), point(0.8, [0.2, 0.2], effort=[1.0, -1.0])]
    assert rig.finish(goal(*points)).outcome == SUCCESS
    efforts = rig.path[:, 7:]
    assert np.abs(np.diff(efforts, axis=0)).max() < 2.0 * PERIOD * 2.0 / 0.4
    np.testing.assert_allclose(efforts.max(axis=0), [2.0, 0.0], atol=0.05)
    np.testing.assert_allclose(rig.reference[3], [1.0, -1.0])
    assert rig.finish(to([0.0, 0.0])).outcome == SUCCESS
    np.testing.assert_allclose(rig.reference[3], 0.0)
    assert np.abs(np.diff(rig.path[:, 7:], axis=0)).max() < 0.05


def stop_the_controller(rig: Rig) -> None:
    rig.report(ControllerState.STOPPED, ControllerState.VELOCITY_LIMIT, 2)


def move_by_hand(rig: Rig) -> None:
    rig.report(ControllerState.FREEDRIVE)


def change_state(rig: Rig, transition: int) -> None:
    request = ChangeState.Request(transition=Transition(id=transition))
    assert rig.testbed.call(ChangeState, "trajectory/change_state", request).success


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (lambda rig: rig.trajectories.publish(JointTrajectory()), "replaced by a stop"),
        (
            lambda rig: rig.trajectories.publish(JointTrajectory(joint_names=NAMES, points=[point(1.0, [0.1, 0.1])])),
            "replaced by a trajectory on joint_trajectory",
        ),
        (stop_the_controller, "joint2 is beyond limits.velocity"),
        (move_by_hand, "a person moves the arm by hand"),
    ],
    ids=["a stop", "a trajectory", "the controller stops", "freedrive"],
)
def test_all_goals_end_with_a_reason(rig: Rig, act: Callable[[Rig], None], reason: str) -> None:
    rig.rest([0.0, 0.0])
    running, waiting = rig.begin(to([0.5, 0.5], 2.0)), Sent(rig, to([0.0, 0.0], start=rig.t + 1.0))
    rig.follow(seconds=0.2)
    act(rig)
    rig.until(lambda: running.done() and waiting.done())
    aborted(Result.INVALID_GOAL, reason)(running.outcome)
    aborted(Result.INVALID_GOAL, reason)(waiting.outcome)
    rig.until(lambda: not rig.reference[1:].any())
    rig.check_smooth()


def test_a_stopped_controller_gets_no_goal_until_its_fault_is_reset(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    stop_the_controller(rig)
    aborted(Result.INVALID_GOAL, "the controller has stopped", "reset_fault")(rig.finish(to([0.1, 0.1])).outcome)
    rig.report(ControllerState.FOLLOWING)
    assert rig.finish(to([0.1, 0.1])).outcome == SUCCESS


def test_goals_end_when_the_clock_is_set(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    sent = rig.begin(to([0.1, 0.1]))
    message = JointState(name=NAMES, position=[0.0, 0.0])
    set_stamp(message.header.stamp, round((rig.t - 0.5) * 1e9))
    rig.joint_states.publish(message)
    rig.step(-0.496)
    rig.until(sent.done)
    aborted(Result.INVALID_GOAL, "joint_states: the source's clock was set")(sent.outcome)


def test_an_arm_that_is_silent_ends_the_goals(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    sent = rig.begin(to([0.1, 0.1]))
    rig.testbed.spin_until(sent.done, "the result")
    aborted(Result.INVALID_GOAL, "no joint state for")(sent.outcome)


def test_a_node_that_is_deactivated_ends_its_goals_and_takes_new_ones_when_it_is_active_again(rig: Rig) -> None:
    rig.rest([0.0, 0.0])
    sent = rig.begin(to([0.1, 0.1]))
    change_state(rig, Transition.TRANSITION_DEACTIVATE)
    rig.testbed.spin_until(sent.done, "the result")
    aborted(Result.INVALID_GOAL, "the node was deactivated")(sent.outcome)
    assert Sent(rig, to([0.1, 0.1])).outcome[0] == REJECTED
    change_state(rig, Transition.TRANSITION_ACTIVATE)
    rig.step()
    rig.rest()
    assert rig.finish(to([0.1, 0.1])).outcome == SUCCESS


def test_a_storm_of_goals_neither_starves_the_reference_nor_outlives_its_cancel(rig: Rig) -> None:
    """Every joint state is answered meanwhile, every goal that is accepted ends, and nothing moves after the cancel."""
    rig.rest([0.0, 0.0])
    under_way: list[Any] = []
    results: list[Any] = []
    rejected = 0
    answered, asked = len(rig.references), 0
    for number in range(STORM):
        if number == 20:  # Now the arm moves.
            before = len(rig.references)
            rig.follow(seconds=0.2)
            asked += len(rig.references) - before
        under_way.append(rig.client.send_goal_async(to([0.2 * math.sin(number), 0.1], 1.0 + number % 3)))
        if len(under_way) == 5:  # DDS keeps ten requests.
            rig.testbed.spin_until(lambda: all(future.done() for future in under_way), "responses")
            accepted = [future.result() for future in under_way if future.result().accepted]
            rejected += len(under_way) - len(accepted)
            results += [handle.get_result_async() for handle in accepted]
            under_way.clear()
            rig.step()
            asked += 1
    assert len(rig.references) - answered == asked, "one reference for each joint state"
    rig.testbed.call(CancelGoal, "trajectory/follow_joint_trajectory/_action/cancel_goal", CancelGoal.Request())
    rig.until(lambda: all(result.done() for result in results))
    statuses = {result.result().status for result in results}
    assert statuses <= {GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_SUCCEEDED}
    rig.until(lambda: not rig.reference[1:].any())
    held = rig.reference[0].copy()
    rig.follow(seconds=0.5)
    np.testing.assert_array_equal(rig.reference[0], held)
    assert rejected == 0 or "goals are rejected: 200 have come within 10 s" in rig.process.log.read_text()
