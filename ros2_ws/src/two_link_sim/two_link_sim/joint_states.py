"""What the drives of the simulated arm report on ``joint_states``."""

from collections.abc import Mapping, Sequence

from sensor_msgs.msg import JointState

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import EFFORT_REPORTED, VELOCITY_CUTOFF, VELOCITY_REPORTED
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.simulation.drive_velocity import DriveVelocity
from pidtsm_core.simulation.gripper import Gripper
from pidtsm_core.timing import seconds
from pidtsm_ros.wire import OutgoingMessage


class Drives:
    """Measured positions, the velocities that the drives estimate from them, and the efforts that they report.

    Nothing of it is the true state of the arm.
    """

    def __init__(self, values: Mapping[str, Value], joints: Sequence[str], gripper: Gripper) -> None:
        """Serialize the message, with the fields that `values`, the node's parameters, choose.

        The joints of the gripper follow those of the arm.
        """
        wanted = {"velocity": values[VELOCITY_REPORTED.name], "effort": values[EFFORT_REPORTED.name]}
        fields = ["position", *(name for name, chosen in wanted.items() if chosen)]
        everything = [*joints, *gripper.joints]
        self._message = OutgoingMessage(JointState(name=everything), fields, joints=len(everything))
        rows = dict(zip(fields, self._message.arrays, strict=True))
        self._rows = {name: row[: len(joints)] for name, row in rows.items()}
        self._others = {name: row[len(joints) :] for name, row in rows.items()}
        self._gripper = gripper
        self._estimate = DriveVelocity(len(joints), as_float(values[VELOCITY_CUTOFF.name]))

    def measure(self, acquired: int, position: Array, effort: Array) -> None:
        """Take a measurement.

        Args:
            acquired: time of its acquisition, ns; the times of a run increase.
            position: measured, shape (joints,), rad or m.
            effort: applied before it, shape (joints,), N m or N.
        """
        self._rows["position"][:] = position
        self._others["position"][:] = self._gripper.position
        if "velocity" in self._rows:
            self._estimate.measure(seconds(acquired), position)
            self._rows["velocity"][:] = self._estimate.velocity
            self._others["velocity"][:] = self._gripper.velocity
        if "effort" in self._rows:
            self._rows["effort"][:] = effort

    def reset(self) -> None:
        """The arm has jumped: the drives begin at rest."""
        self._estimate.reset()

    def to_bytes(self, stamp: int) -> bytes:
        """The joint state of the last measurement; `stamp` in ns."""
        return self._message.to_bytes(stamp)
