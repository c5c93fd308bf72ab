"""Whether an arm can follow a trajectory."""

from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion


def check(motion: PiecewiseMotion, limits: MotionLimits) -> None:
    """Check that a motion keeps the limits of position, velocity, given acceleration and effort.

    A joint that is outside its position limits at the begin may move back inside. Compiled, without the GIL.

    Args:
        motion: the motion.
        limits: of the arm; each limit that is infinite is not checked, nor is the effort without a model.

    Raises:
        TrajectoryError: a limit is exceeded; the message has joint, amount, limit and time.
    """
