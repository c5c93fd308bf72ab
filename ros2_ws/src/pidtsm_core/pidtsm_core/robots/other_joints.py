"""Joints of a description that do not belong to the arm, such as those of a gripper."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from pidtsm_core.robots.compiler import COUPLE, SLIDE


class OtherJoint(NamedTuple):
    """A joint that does not move with the arm.

    Attributes:
        lower, upper: position limits, rad or m; infinite if there are none.
        slides: whether it is prismatic.
        mimics: name of the joint that it follows; empty: none.
        factor, offset: its position is that of this joint times `factor`, plus `offset` (rad or m).
    """

    lower: float = -math.inf
    upper: float = math.inf
    slides: bool = False
    mimics: str = ""
    factor: float = 1.0
    offset: float = 0.0


def other_joint(model: Any, names: Sequence[str], joint: int) -> OtherJoint:
    """What a compiled model has of a joint.

    Args:
        model: of type ``mujoco.MjModel``.
        names: of its joints.
        joint: index of the joint.
    """
    low, high = model.jnt_range[joint].tolist() if model.jnt_limited[joint] else (-math.inf, math.inf)
    found = OtherJoint(low, high, bool(model.jnt_type[joint] == SLIDE))
    for i in range(model.neq):
        if model.eq_type[i] == COUPLE and model.eq_obj1id[i] == joint and model.eq_obj2id[i] >= 0:
            offset, factor = model.eq_data[i, :2].tolist()
            return found._replace(mimics=names[model.eq_obj2id[i]], factor=factor, offset=offset)
    return found
