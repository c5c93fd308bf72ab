"""Errors of robot descriptions."""


class DescriptionError(ValueError):
    """A description that cannot be used; the message contains the link or joint."""
