"""The version of pidtsm, defined here alone; a test compares what the packages say with it."""

__version__ = "0.2.0"
