"""The errors of this package."""


class TrajectoryError(ValueError):
    """A trajectory cannot be followed; the message gives the reason."""


class StartError(TrajectoryError):
    """It is too far from the present reference where it begins."""
