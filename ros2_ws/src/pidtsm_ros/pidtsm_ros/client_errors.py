"""What goes wrong when a client moves the arm."""


class ArmError(RuntimeError):
    """The arm did not do what it should; the message gives the reason."""


class ArmNotFoundError(ArmError):
    """There is no running system."""


class TargetError(ArmError, ValueError):
    """A target that is none: the number or the name of a joint, or a scale, is wrong."""


class GoalError(ArmError):
    """A motion was rejected or ended before its goal.

    Attributes:
        code: error code of control_msgs/action/FollowJointTrajectory.
    """

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code
