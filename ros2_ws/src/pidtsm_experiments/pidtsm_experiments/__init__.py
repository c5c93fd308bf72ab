"""Scenarios, launch files, recorder, runner, bag analysis, report and command line."""
