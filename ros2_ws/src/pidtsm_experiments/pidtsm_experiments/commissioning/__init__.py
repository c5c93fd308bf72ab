"""Commissioning of an arm over ROS: a process holds and moves it, and outlives the session that guides it."""
