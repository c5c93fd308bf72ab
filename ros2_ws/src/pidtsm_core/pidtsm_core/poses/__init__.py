"""Motions of the tool: poses, differential inverse kinematics, frames, and paths within limits."""
