"""Trajectories that are commanded or planned: interpolated, checked against the limits of the arm, spliced, stopped."""
