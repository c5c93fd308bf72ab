"""Two arms beside each other clap: both get the same path of the tool, mirrored, and begin together.

Needs two systems that run in real time in the namespaces left and right, with robot.description set to panda:
ros2 launch pidtsm_experiments two_arms.launch.py robot:=panda set:=trajectory.robot.description=panda
"""

import numpy as np

from pidtsm_ros.client import Arm

HOME = [0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8]
INWARDS = {"left": -0.1, "right": 0.1}
"""Along y of each base, m."""

with Arm("left", robot="panda") as left, Arm("right", robot="panda") as right:
    arms = {"left": left, "right": right}
    for arm in arms.values():
        arm.move_to(HOME, velocity_scale=0.5, wait=False)
    for arm in arms.values():
        arm.wait(30.0)
    for way in (1.0, -1.0):
        for side, arm in arms.items():
            target = arm.tool.moved(np.array([0.0, way * INWARDS[side], 0.0]), np.zeros(3))
            arm.move_to_pose(target.position, wait=False)
        for arm in arms.values():
            arm.wait(30.0)
        print({side: arm.tool.position.round(3).tolist() for side, arm in arms.items()})
