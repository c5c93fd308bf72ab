"""What is wrong with a loop, from a recording of it."""
