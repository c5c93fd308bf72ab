"""Judging messages by their stamps and publishers, without ROS."""
