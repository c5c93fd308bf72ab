"""The controller: everything between a measured position and the commanded effort, as one compiled step."""

from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.controller import Controller
from pidtsm_core.control.parameters import ESTIMATOR_NAME, LAW_NAME, controller_schema
from pidtsm_core.control.state import Condition, ControllerState, Count, Time
from pidtsm_core.control.step import copy_signals, step

__all__ = [
    "ESTIMATOR_NAME",
    "LAW_NAME",
    "Condition",
    "Controller",
    "ControllerConfig",
    "ControllerState",
    "Count",
    "Time",
    "controller_schema",
    "copy_signals",
    "step",
]
