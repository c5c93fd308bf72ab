"""Where the tool is, and joints that follow it: differential inverse kinematics by mink on the model of MuJoCo."""

import math
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError, did_you_mean
from pidtsm_core.poses.parameters import ANGULAR_VELOCITY, TOOL_FRAME, VELOCITY
from pidtsm_core.poses.pose import NOWHERE_ELSE, Pose
from pidtsm_core.robots import Robot, TreeRobot
from pidtsm_core.robots.compiler import compile_spec
from pidtsm_core.robots.rigid_bodies import TOOL, described_bodies, text_bodies
from pidtsm_core.trajectories.limits import MotionLimits

SOLVER = "daqp"
"""A dual active-set solver of quadratic programs (Arnstrom, Bemporad, Axehill, IEEE TAC 67, 2022)."""
_LENGTH = 0.3
"""1 rad counts as much as this distance, m."""
_POSITION_FIRST = 3e-4
"""The same for arms with fewer joints than a pose has numbers, whose tool cannot have any orientation."""
_POSTURE_TIME = 1.0
"""Time in which the posture is approached, s."""
_DAMPING, _TRUST = 1e-6, 0.3
"""Weight of the squared step of a joint beside that towards the posture, relative to 1 m^2 at the tool and per rad^2: a
number, and a share of the error. Where the error cannot vanish, its product with the curvature of the tool's way stands
against the step, which would oscillate without."""
_LONGEST_STEP = 0.01
"""Longest step of the differential kinematics, s."""
_MOST_STEPS = 20
_SHARE = 0.9
"""Share of the velocity of planned motions that is used; the rest lets the reference catch up."""
NEAR_LIMIT = 1e-3
"""A joint that is closer to its limit is at its limit, rad or m."""
_SINGULAR = 0.02
"""Near a singularity, the smallest singular value of the Jacobian (m and `_LENGTH` rad, per rad) is smaller."""
_FASTEST = 1e3
"""Largest velocity of a joint without a limit, rad/s or m/s."""


class Distance(NamedTuple):
    """What is left to a pose, and why.

    Attributes:
        position: m.
        angle: rad; 0 for arms that cannot turn their tool at will.
        at_limit: names of the joints that are at a limit of their position.
        singular: whether the arm is near a singularity.
    """

    position: float
    angle: float
    at_limit: tuple[str, ...]
    singular: bool


class ToolKinematics:
    """The kinematics of an arm for one frame, the tool.

    Not for several threads at once.

    Attributes:
        links: names of the frames that are known: the links of the description.
        full: whether the arm has enough joints for any orientation of the tool.
    """

    def __init__(
        self,
        robot: Robot,
        limits: MotionLimits,
        tool: str = "",
        velocity: float = float(VELOCITY.default),  # type: ignore[arg-type]
        angular_velocity: float = float(ANGULAR_VELOCITY.default),  # type: ignore[arg-type]
    ) -> None:
        """Build the model.

        Args:
            robot: the arm.
            limits: its limits; positions of joints are in the order of ``limits.joints``.
            tool: name of a link of the description; empty: the tool of the description.
            velocity: largest one of the tool, m/s.
            angular_velocity: likewise, rad/s.

        Raises:
            ParameterError: mink is not installed, or there is no such link, or nothing is known about the arm's bodies.
        """
        try:
            import mink
        except ModuleNotFoundError as error:
            raise ParameterError(
                f"poses need {error.name}: ./pidtsm installs it; elsewhere pip install 'pidtsm[poses]'"
            ) from None
        self._mink, self._limits = mink, limits
        self._speeds = velocity, angular_velocity
        model = compile_spec(_bodies(robot))
        names = dict(zip(np.array(limits.joints)[limits.places], robot.joints, strict=True))
        joints = [model.joint(names[name]) for name in limits.joints]
        self._addresses = np.array([int(joint.qposadr[0]) for joint in joints])
        for joint, lower, upper in zip(joints, limits.lower, limits.upper, strict=True):
            limited = bool(np.isfinite([lower, upper]).all())
            model.jnt_limited[joint.id], model.jnt_range[joint.id] = limited, (lower, upper) if limited else (0.0, 0.0)
        self.full = len(joints) >= 6
        self._links = robot.description.links.names if isinstance(robot, TreeRobot) else (robot.base,)
        self._frame = (tool, "body") if tool else (TOOL, "site")
        self._base = robot.base
        if tool and tool not in self._links[1:]:
            hint = did_you_mean(tool, self._links[1:]) or f"; links: {', '.join(self._links[1:])}"
            raise ParameterError(f"{TOOL_FRAME.name}: {robot.name} has no link {tool}{hint}", TOOL_FRAME.name)
        self._configuration = mink.Configuration(model)
        cost = _LENGTH if self.full else _POSITION_FIRST
        self._task = mink.FrameTask(*self._frame, position_cost=1.0, orientation_cost=cost)
        self._posture = mink.PostureTask(model, math.sqrt(_DAMPING))
        self._posture.set_target(self._configuration.q)
        fastest = np.minimum(_SHARE * limits.planned_velocity, _FASTEST)
        rates = {joint.name: float(rate) for joint, rate in zip(joints, fastest, strict=True)}
        self._bounds = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, rates)]

    @property
    def links(self) -> tuple[str, ...]:
        return self._links

    def prefer(self, q: Array) -> None:
        """Approach this posture, shape (joints,), rad or m, as far as the tool leaves the choice."""
        self._posture.set_target(self._configured(q))

    def pose(self, q: Array, link: str | None = None) -> Pose:
        """The tool, or a link, in the base frame.

        Args:
            q: positions of the joints, shape (joints,), rad or m.
            link: one of `links`; None: the tool.
        """
        self._configuration.update(self._configured(q))
        return self._placed(*((link, "body") if link else self._frame))

    def toward(self, q: Array, goal: Pose, duration: float) -> tuple[Array, Distance]:
        """Move the tool towards a pose, on a straight line as far as the limits of the joints allow.

        Args:
            q: positions of the joints, shape (joints,), rad or m; those beyond a limit count as at the limit.
            goal: of the tool in the base frame.
            duration: of the motion, s; the tool and the joints move at most as far as their velocities allow.

        Returns:
            Positions of the joints then, shape (joints,), and what is left to the goal.
        """
        configuration = self._configuration
        configuration.update(self._configured(np.clip(q, self._limits.lower, self._limits.upper)))
        steps = min(max(int(np.ceil(duration / _LONGEST_STEP)), 1), _MOST_STEPS)
        dt = duration / steps
        self._posture.gain = min(dt / _POSTURE_TIME, 1.0)
        for k in range(steps):
            self._task.set_target(self._as_se3(self._nearer(self._placed(*self._frame), goal, dt, steps - k)))
            if not self._step(dt):
                break
        found = configuration.q[self._addresses]
        return found, self._distance(found, goal)

    def _step(self, dt: float) -> bool:
        """Move on by one step; whether that was possible."""
        configuration, tasks = self._configuration, [self._task, self._posture]
        error = np.linalg.norm(self._task.cost * self._task.compute_error(configuration))
        self._posture.set_cost(math.sqrt(_DAMPING + _TRUST * float(error)))
        try:
            rates = self._mink.solve_ik(configuration, tasks, dt, SOLVER, limits=self._bounds)
        except self._mink.NoSolutionFound:
            return False
        if not np.isfinite(rates).all():
            return False
        configuration.integrate_inplace(rates, dt)
        return True

    def _nearer(self, present: Pose, goal: Pose, dt: float, left: int) -> Pose:
        """The pose on the way to the goal that is reached in dt, so that the goal is reached in `left` times dt."""
        way, turn = present.way_to(goal)
        fastest = max(np.linalg.norm(way) / self._speeds[0], self.full * np.linalg.norm(turn) / self._speeds[1])
        share = min(1.0 / left, dt / max(fastest, 1e-12))
        return goal if share >= 1.0 else present.moved(share * way, share * turn)

    def _distance(self, q: Array, goal: Pose) -> Distance:
        way, turn = self._placed(*self._frame).way_to(goal)
        limits = self._limits
        near = (q < limits.lower + NEAR_LIMIT) | (q > limits.upper - NEAR_LIMIT)
        jacobian = self._configuration.get_frame_jacobian(*self._frame)
        weights = np.repeat([1.0, _LENGTH], 3) if self.full else np.repeat([1.0, 0.0], 3)
        values = np.linalg.svd(weights[:, None] * jacobian, compute_uv=False)
        smallest = float(values[min(len(q), 6 if self.full else 3) - 1])
        names = tuple(name for name, at in zip(limits.joints, near, strict=True) if at)
        angle = float(np.linalg.norm(turn)) if self.full else 0.0
        return Distance(float(np.linalg.norm(way)), angle, names, smallest < _SINGULAR)

    def _configured(self, q: Array) -> Array:
        """Positions in the order of MuJoCo."""
        configured = np.empty_like(q)
        configured[self._addresses] = q
        return configured

    def _placed(self, name: str, kind: str) -> Pose:
        if kind == "body" and name == self._base:
            return NOWHERE_ELSE
        found = self._configuration.get_transform_frame_to_world(name, kind).as_matrix()
        return Pose(found[:3, 3], found[:3, :3])

    def _as_se3(self, pose: Pose) -> Any:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.position
        return self._mink.SE3.from_matrix(matrix)


def _bodies(robot: Robot) -> Any:
    """The bodies of the arm, of type ``mujoco.MjSpec``.

    Raises:
        ParameterError: nothing is known about them.
    """
    if isinstance(robot, TreeRobot):
        return described_bodies(robot.description)
    if robot.mjcf is None:
        raise ParameterError(f"{robot.name} is a closed form without an MJCF, so that poses of its tool are not known")
    defaults = {f"robot.{p.name}": p.default for p in robot.parameters}
    return text_bodies(robot.mjcf(robot.pack_model(defaults)))
