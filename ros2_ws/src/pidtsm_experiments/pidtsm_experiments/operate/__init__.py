"""A running system, started, looked at and operated from the command line."""
