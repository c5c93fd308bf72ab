"""Commissioning of an arm without ROS: what each step moves, and what it concludes from the samples."""
