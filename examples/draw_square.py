"""The Panda draws a square of 20 cm with its tool: inverse kinematics, a motion within limits, a rollout."""

from itertools import pairwise

import numpy as np

import pidtsm_core as pidtsm
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot, robot_schema
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.timing import retime
from pidtsm_core.trajectories.tool import inverse_kinematics, tool_pose

ARM = {"robot.description": "panda"}
robot = find_robot(ARM)
values = resolve(robot_schema, ARM, len(robot.joints))
start = np.array([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8])
centre, axes = tool_pose(robot, values, start)

# The corners in the plane of the table, and points between them, 1 cm apart; the tool keeps its orientation.
corners = 0.1 * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0]])
share = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None]
line = [a + share * (b - a) for a, b in pairwise(corners)]
points = centre + np.concatenate([*line, corners[-1:]])
postures = []
for point in points:
    start = inverse_kinematics(robot, values, point, axes, start)
    postures.append(start)
motion = retime(np.array(postures), motion_limits(ARM))
# The motion as a file, which the controller follows in a rollout.
times = np.linspace(0.0, motion.end, 500)
states = np.zeros((times.size, 3, len(robot.joints)))
for t, state in zip(times, states, strict=True):
    motion.evaluate(t, state)
names = [f"{derivative}_{joint}" for derivative in ("q", "dq", "ddq") for joint in robot.joints]
table = np.column_stack([times, states.reshape(times.size, -1)])
np.savetxt("square.csv", table, delimiter=",", header=",".join(["time", *names]), comments="")
motion_file = {"reference.name": "csv", "reference.file": "square.csv"}
simulator = {**ARM, "initial_position": postures[0].tolist()}
settings = {"simulator": simulator, "controller": ARM, "trajectory": motion_file}
run = pidtsm.rollout(pidtsm.Experiment("square", "", motion.end + 0.5, settings), params="practical")
drawn, wanted = ([tool_pose(robot, values, q)[0] for q in path[::10]] for path in (run.position, run.desired))
distance = 1e3 * np.linalg.norm(np.subtract(drawn, wanted), axis=1).max()
print(f"{motion.end:.2f} s; largest distance of the tool from its path: {distance:.2f} mm")
