"""Launch files, recorder, runner, bag analysis and command line."""
