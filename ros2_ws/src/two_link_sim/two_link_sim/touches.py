"""Contact forces of the simulated arm as messages: one topic for each body that touches something."""

import re
from collections.abc import Mapping, Sequence

from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from std_msgs.msg import Header

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp

FOLDER = "~/contact"
"""What precedes the name of the body in that of its topic."""
_NOT_IN_NAMES = re.compile(r"\W")


class Touches:
    """The topics of the bodies. While a body touches, each sample has a message; one with zeros follows the last."""

    def __init__(self, node: ManagedNode, bodies: Sequence[str]) -> None:
        """Create the topic of each of these bodies."""
        self._topics = {
            body: node.advertise(WrenchStamped, f"{FOLDER}/{_NOT_IN_NAMES.sub('_', body)}") for body in bodies
        }
        self._prefix = str(node.values[FRAME_PREFIX.name])
        self._touching: Mapping[str, Array] = {}

    def __bool__(self) -> bool:
        return bool(self._topics)

    def publish(self, wrenches: Mapping[str, Array], stamp: int) -> None:
        """Publish the wrenches of a sample.

        Args:
            wrenches: by body, shape (6,), see `contact_wrenches`.
            stamp: of the sample, ns.
        """
        for body in {**self._touching, **wrenches}:
            wrench = wrenches[body].tolist() if body in wrenches else [0.0] * 6
            force, torque = Vector3(**_xyz(wrench[:3])), Vector3(**_xyz(wrench[3:]))
            message = WrenchStamped(
                header=Header(frame_id=self._prefix + body), wrench=Wrench(force=force, torque=torque)
            )
            set_stamp(message.header.stamp, stamp)
            self._topics[body].publish(message)
        self._touching = wrenches


def _xyz(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", values, strict=True))
