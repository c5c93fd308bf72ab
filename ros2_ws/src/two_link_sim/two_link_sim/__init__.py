"""Simulated two-link arm as a ROS 2 node."""
