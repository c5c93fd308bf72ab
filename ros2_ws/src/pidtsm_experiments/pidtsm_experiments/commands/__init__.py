"""Commands of the command line, one per module: `add_arguments` describes the command, `execute` runs it."""
