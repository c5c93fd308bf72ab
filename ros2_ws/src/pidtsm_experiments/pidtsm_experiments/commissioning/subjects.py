"""What is commissioned, according to the parameters of a controller."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pidtsm_core.control import controller_schema
from pidtsm_core.parameters import joint_array
from pidtsm_core.robots import OF_ARM, Description, find_description
from pidtsm_core.robots.payload import CENTER, MASS, Payload
from pidtsm_core.robots.tree_robot import add_load
from pidtsm_studies.commissioning.session import Subject

_OF_ARM = (*OF_ARM, "robot.armature", "limits.effort", MASS, CENTER.name)
"""Parameters of the controller that choose the arm; those that are empty or zero choose nothing."""


def believed_arm(known: Mapping[str, Any]) -> Description:
    """The arm of a controller as it believes it to be: with its payload and its effort limits.

    Args:
        known: parameters of the controller.

    Raises:
        ParameterError: see `find_description`.
    """
    arm = find_description(known)
    joints, tree = len(arm.joints), arm.tree.copy()
    if mass := float(known.get(MASS, 0.0)):
        add_load(arm, tree, Payload(mass, np.array(known.get(CENTER.name, (0.0, 0.0, 0.0)), dtype=np.float64)))
    limit = joint_array(known.get("limits.effort", tuple(arm.effort)), joints)
    return replace(arm, tree=tree, effort=limit)


def subject_of(values: Mapping[str, Any]) -> Subject:
    """What is commissioned where a controller runs.

    Args:
        values: every parameter of its node.

    Raises:
        ParameterError: the arm cannot be used.
    """
    arm = {name: values[name] for name in _OF_ARM if name in values and np.any(np.asarray(values[name], dtype=object))}
    of_controller = {parameter.name for parameter in controller_schema(values)}
    before = {name: value for name, value in values.items() if name in of_controller}
    return Subject(arm, before, None, lambda: believed_arm(arm))
