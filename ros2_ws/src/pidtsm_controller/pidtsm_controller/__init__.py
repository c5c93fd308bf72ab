"""The controller and the trajectory as ROS 2 nodes."""
