"""Simulated hardware between the controller and the rigid arm; every effect is off by default.

True state -> `sensor` -> `channel` -> controller -> `channel` -> `actuator` -> dynamics (`plant`), with random numbers
from `randomness`. `pidtsm_core.simulation.simulator` combines them in this order.
"""
