"""Rollouts: the closed loop in one compiled function, and many of them."""
