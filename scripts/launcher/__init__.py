"""Set-up of the checkout by `./pidtsm`, on the first call, before the command line of pidtsm_experiments starts."""
