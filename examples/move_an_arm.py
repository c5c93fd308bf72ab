"""The tool of a running Panda draws a square of 20 cm: the Python client, inverse kinematics, a motion within limits.

Needs a system that runs in real time, with the parameter robot.description of the nodes set to panda.
"""

from itertools import pairwise

import numpy as np

from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot, robot_schema
from pidtsm_core.trajectories.timing import retime
from pidtsm_core.trajectories.tool import inverse_kinematics, tool_pose
from pidtsm_ros.client import Arm

ARM = {"robot.description": "panda"}
robot = find_robot(ARM)
values = resolve(robot_schema, ARM, len(robot.joints))

with Arm(robot="panda") as arm:
    arm.move_to([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], velocity_scale=0.5)
    posture = arm.state.desired[0]
    centre, axes = tool_pose(robot, values, posture)
    corners = 0.1 * np.array([[0, 0, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0], [0, 0, 0]])
    postures = [posture]
    for start, end in pairwise(corners):
        for share in np.linspace(0.0, 1.0, 21)[1:]:
            point = centre + start + share * (end - start)
            postures.append(inverse_kinematics(robot, values, point, axes, postures[-1]))
    motion = retime(np.array(postures), arm.limits)
    arm.follow(motion)
    arm.wait(10.0 + 2.0 * motion.end)
    tool, _ = tool_pose(robot, values, arm.state.position)
    print(f"{len(postures)} points in {motion.end:.2f} s; the tool is at {tool}")
