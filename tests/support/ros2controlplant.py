"""An arm that ros2_control drives, written from its documentation and standard messages alone.

The parts are a controller manager, a broadcaster of joint states, a controller that forwards efforts, and the hardware.
MuJoCo moves the arm.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import nanoseconds, set_stamp
from support.testbed import Testbed

Vector = NDArray[np.float64]

PERIOD = 0.001  # s
SECOND = 1_000_000_000  # ns
EPOCH = 1_700_000_000 * SECOND
"""ns; time of its first joint state."""
FRICTION, ROTOR = 0.2, 0.1
"""N m, and kg m^2: of every joint; the URDF of the Panda has them for our simulator only."""


class EffortController:
    """forward_command_controller: what it was last told, it applies; what it applied, the hardware keeps.

    `zeroes` when it is deactivated, as effort_controllers/JointGroupEffortController does.
    """

    def __init__(self, joints: int, zeroes: bool) -> None:
        self.active, self.zeroes = False, zeroes
        self.told = np.full(joints, np.nan)
        self.interface = np.full(joints, np.nan)
        """What the hardware reads, N m."""

    def receive(self, message: Float64MultiArray) -> None:
        self.told = np.array(message.data)

    def switch(self, on: bool) -> None:
        self.active = on
        self.told = np.full_like(self.told, np.nan)
        if not on and self.zeroes:
            self.interface = np.zeros_like(self.interface)

    def update(self) -> None:
        if self.active and not np.isnan(self.told).all():
            self.interface = self.told


class Ros2Control:
    """The controller manager with its arm.

    While no controller has claimed the efforts, the arm holds itself: by its brakes, or by control of its own.

    Attributes:
        now: time since the first joint state, ns.
        awaits: whether a cycle takes as long as our controller needs for its command, while it is heard.
        ended: our controller commands no more.
        noise: standard deviation of the measured positions, rad.
        silent: the manager reports nothing.
        dead: the arm answers no more, and the hardware repeats what it heard last, with new stamps.
        commands: every command of ours, N m.
        positions, efforts: of the arm in every cycle, rad and N m; nan: it holds itself.
    """

    def __init__(self, testbed: Testbed, urdf: Path, joints: list[str], start: list[float], zeroes: bool) -> None:
        """Args: testbed: open; urdf: of the arm; joints: in the order of the URDF; start: rad; zeroes: see above."""
        self.testbed, self.joints = testbed, joints
        self.model = mujoco.MjModel.from_xml_path(str(urdf))
        self.model.opt.timestep = PERIOD
        self.model.dof_frictionloss[:], self.model.dof_armature[:] = FRICTION, ROTOR
        self.arm = mujoco.MjData(self.model)
        self.arm.qpos[:] = start
        mujoco.mj_forward(self.model, self.arm)
        self.controller = EffortController(len(joints), zeroes)
        self.now, self.awaits, self.dead, self.noise = 0, False, False, 0.0
        self.random = np.random.default_rng(1)
        self.silent = False
        self.ended: Callable[[], bool] = lambda: False
        self.commands: list[Vector] = []
        self.positions: list[Vector] = []
        self.efforts: list[Vector] = []
        self.node = Node("controller_manager", context=testbed.context)
        testbed.executor.add_node(self.node)
        self.diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.states = self.node.create_publisher(JointState, "joint_states", 10)
        self.referred = 0  # stamp of the last reference, ns
        self.node.create_subscription(JointReference, "reference", self._refer, 10)
        self.node.create_subscription(Float64MultiArray, "effort_controller/commands", self._receive, 10)

    def _receive(self, message: Float64MultiArray) -> None:
        self.commands.append(np.array(message.data))
        self.controller.receive(message)

    def _refer(self, message: JointReference) -> None:
        self.referred = nanoseconds(message.header.stamp)

    def switch(self, on: bool) -> None:
        """Activate or deactivate the effort controller."""
        self.controller.switch(on)

    def report(self) -> None:
        """What the manager says of its controllers, once a second."""
        state = "active" if self.controller.active else "inactive"
        values = [KeyValue(key="effort_controller.state", value=state)]
        status = DiagnosticStatus(name="controller_manager: Controllers Activity", values=values)
        self.diagnostics.publish(DiagnosticArray(status=[status]))

    def cycle(self) -> None:
        """Read, update, write; then the arm moves until the next cycle, a period later at the earliest."""
        count, due = len(self.commands), time.monotonic() + PERIOD
        message = JointState(
            name=self.joints,
            position=(self.arm.qpos + self.noise * self.random.standard_normal(len(self.joints))).tolist(),
        )
        stamp = EPOCH + self.now
        set_stamp(message.header.stamp, stamp)
        self.states.publish(message)
        self.controller.update()
        applied = self.controller.interface
        held = not self.controller.active or np.isnan(applied).any()
        self.positions.append(self.arm.qpos.copy())
        self.efforts.append(np.full_like(applied, np.nan) if held else applied)
        if held or self.dead:
            self.arm.qvel[:] = 0.0
        else:
            self.arm.qfrc_applied[:] = applied
            mujoco.mj_step(self.model, self.arm)
        self.now += round(PERIOD * SECOND)
        if self.now % SECOND == 0 and not self.silent:
            self.report()
        if self.awaits:
            # Faster than the trajectory node can answer nobody need be; it may hear of the arm after the controller.
            self.testbed.spin_until(
                lambda: self.ended() or (len(self.commands) > count and not 0 < self.referred < stamp),
                f"a command at {self.now / SECOND} s",
            )
        while (left := due - time.monotonic()) > 0.0:
            self.testbed.executor.spin_once(timeout_sec=left)

    def go_on(self, seconds: float, until: Callable[[], Any] = lambda: False) -> bool:
        """Cycle for a time, or until something is true; returns whether it is."""
        end = self.now + round(seconds * SECOND)
        while not (found := bool(until())) and self.now < end:
            self.cycle()
        return found

    def close(self) -> None:
        self.testbed.executor.remove_node(self.node)
        self.node.destroy_node()
