"""ROS-free heart of pidtsm: robots, laws, estimators, references, plant, rollout and metrics."""
