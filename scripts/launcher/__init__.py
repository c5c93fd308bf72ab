"""What `./pidtsm` does before the command line of pidtsm_experiments runs: set up once, then start at once."""
