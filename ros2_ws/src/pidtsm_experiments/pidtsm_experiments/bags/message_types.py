"""Message definitions for reading and writing bags without ROS."""

import os
from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pidtsm_experiments.bags.errors import RecordingError

_OWN_MESSAGES = ("JointReference", "ControllerState")


@cache
def typestore() -> Typestore:
    """Types of ROS 2 Jazzy and of pidtsm_msgs; a shared object, so do not register other types in it.

    Raises:
        RecordingError: the .msg files of pidtsm_msgs are neither installed nor in the same source tree.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in _OWN_MESSAGES:
        store.register(get_types_from_msg(_definition(name), f"pidtsm_msgs/msg/{name}"))
    return store


def _definition(name: str) -> str:
    shares = [Path(p, "share") for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    package = Path(__file__).resolve().parents[1]  # The wheel has them there, a source tree beside its packages.
    for root in (*shares, package, package.parents[1]):
        file = root / "pidtsm_msgs" / "msg" / f"{name}.msg"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise RecordingError(f"{name}.msg of pidtsm_msgs not found: source the workspace")
