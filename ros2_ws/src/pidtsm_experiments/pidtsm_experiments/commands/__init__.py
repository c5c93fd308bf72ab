"""One command of the command line a module: `add_arguments` describes it, `execute` does it."""
