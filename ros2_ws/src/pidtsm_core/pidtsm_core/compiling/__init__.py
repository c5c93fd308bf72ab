"""What compiles the functions of this package: decorators, memory by address, functions that are compiled alone."""
