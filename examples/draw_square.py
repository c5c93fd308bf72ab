"""The Panda draws a square of 20 cm with its tool: poses, a motion within limits, a rollout."""

from itertools import pairwise

import numpy as np

import pidtsm_core as pidtsm
from pidtsm_core.poses.kinematics import ToolKinematics
from pidtsm_core.poses.paths import Speed, line, plan_path
from pidtsm_core.robots import find_robot
from pidtsm_core.trajectories.limits import motion_limits

ARM = {"robot.description": "panda"}
robot, limits = find_robot(ARM), motion_limits(ARM)
tool = ToolKinematics(robot, limits)
start = np.array([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8])
centre = tool.pose(start)

# From the centre to a corner, around the square in the plane of the table, and back; the tool keeps its orientation.
shifts = 0.1 * np.array([[0, 0, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0], [0, 0, 0]])
corners = [centre.moved(shift, np.zeros(3)) for shift in shifts]
poses = [pose for a, b in pairwise(corners) for pose in line(a, b)]
motion = plan_path(tool, start, poses, limits, Speed(velocity=0.5, acceleration=3.0))
# The motion as a file, which the controller follows in a rollout.
times = np.linspace(0.0, motion.end, 500)
states = np.zeros((times.size, 3, len(robot.joints)))
for t, state in zip(times, states, strict=True):
    motion.evaluate(t, state)
names = [f"{derivative}_{joint}" for derivative in ("q", "dq", "ddq") for joint in robot.joints]
table = np.column_stack([times, states.reshape(times.size, -1)])
np.savetxt("square.csv", table, delimiter=",", header=",".join(["time", *names]), comments="")
motion_file = {"reference.name": "csv", "reference.file": "square.csv"}
simulator = {**ARM, "initial_position": start.tolist()}
settings = {"simulator": simulator, "controller": ARM, "trajectory": motion_file}
run = pidtsm.rollout(pidtsm.Experiment("square", "", motion.end + 0.5, settings), params="practical")
drawn, wanted = ([tool.pose(q).position for q in path[::10]] for path in (run.position, run.desired))
distance = 1e3 * np.linalg.norm(np.subtract(drawn, wanted), axis=1).max()
print(f"{motion.end:.2f} s; largest distance of the tool from its path: {distance:.2f} mm")
