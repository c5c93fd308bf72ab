"""Detectors: a file for each cause, or for those that only one estimate can tell apart."""
