"""Identification: from measured motions and torques to the parameters of an arm."""
