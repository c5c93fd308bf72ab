"""Controller and trajectory generator as ROS 2 nodes."""
