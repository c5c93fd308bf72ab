"""The tool of a running Panda draws a square of 20 cm: the Python client, poses, a motion within limits.

Needs a system that runs in real time, with the parameter robot.description of the nodes set to panda.
"""

from itertools import pairwise

import numpy as np

from pidtsm_core.poses.paths import Speed, line
from pidtsm_ros.client import Arm

with Arm(robot="panda") as arm:
    arm.move_to([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], velocity_scale=0.5)
    centre = arm.tool
    shifts = 0.1 * np.array([[0, 0, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0], [0, 0, 0]])
    corners = [centre.moved(shift, np.zeros(3)) for shift in shifts]
    poses = [pose for start, end in pairwise(corners) for pose in line(start, end)]
    duration = arm.follow_poses(poses, Speed(velocity=0.5, acceleration=3.0))
    print(f"{len(poses)} points in {duration:.2f} s; the tool is at {arm.tool.position}")
