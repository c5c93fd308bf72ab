"""The error of this package."""


class TrajectoryError(ValueError):
    """A trajectory cannot be followed; the message gives the reason."""
