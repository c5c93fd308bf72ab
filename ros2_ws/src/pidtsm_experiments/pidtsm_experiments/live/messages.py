"""Messages that a page or a command sends."""

from collections.abc import Sequence

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


def one_point(joints: Sequence[str], target: Sequence[float], duration: float) -> JointTrajectory:
    """A motion to a posture, at rest there.

    Args:
        joints: names.
        target: position of each, rad or m.
        duration: s.
    """
    still = [0.0] * len(joints)
    point = JointTrajectoryPoint(positions=list(target), velocities=still, accelerations=still)
    point.time_from_start.sec, point.time_from_start.nanosec = divmod(round(duration * 1e9), 10**9)
    return JointTrajectory(joint_names=list(joints), points=[point])
