"""Simulated hardware between the controller and the rigid arm, each effect off by default.

True state -> `sensor` -> `channel` -> controller -> `channel` -> `actuator` -> dynamics (`plant`), with the numbers
of `randomness`. `pidtsm_core.simulation.simulator` puts them in this order.
"""
