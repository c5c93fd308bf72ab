"""What the controller keeps about drives that are late, see lateness.py."""

from enum import IntEnum
from typing import Any

import numpy as np

from pidtsm_core.control.bank import MOST_UNDER_WAY, new_bank


class UnderWay(IntEnum):
    """Rows of what is known of a command that may still be under way, per joint; see lateness.py."""

    EFFORT = 0  # that the drive delivers for it, N m
    ADDED = 1  # what was added to the law's, see `ControllerState.added`, N m
    ACCELERATION = 2  # of the model under the rest, rad/s^2


class Predicted(IntEnum):
    """Rows of the motion that is predicted for the time at which the command acts."""

    POSITION = 0  # rad
    VELOCITY = 1  # rad/s
    ACCELERATION = 2  # rad/s^2


class Lateness(IntEnum):
    """What is known of the lateness of the drives beyond ``drive``, s; see lateness_learning.py."""

    DELAY = 0  # used
    LAG = 1  # likewise
    FOUND_DELAY = 2
    FOUND_LAG = 3
    DEVIATION = 4  # standard deviation of the sum that was found
    LATE = 5  # 1: the drives are later than ``drive`` says, or were
    OBSERVED = 6  # for how long the arm has followed its reference so far


def late_drives(joints: int) -> dict[str, Any]:
    """Parts of the controller's state by name, for this number of joints; shapes as in `ControllerState`."""
    return {
        "commanded": np.zeros(joints),
        "drive": np.zeros(joints),
        "under_way": np.zeros((MOST_UNDER_WAY, len(UnderWay), joints)),
        "under_way_held": np.zeros(MOST_UNDER_WAY),
        "under_way_newest": np.zeros(1, np.int64),
        "delivered": np.zeros(joints),
        "damped": np.zeros(joints),
        "undamped": np.zeros(joints),
        "predicted": np.zeros((len(Predicted), joints)),
        "ahead": np.zeros((3, joints)),
        "lateness": np.zeros(len(Lateness)),
        "bank": new_bank(joints),
    }
