"""What the nodes import and compile before they begin; imported once, by the process that forks them."""

import gc
import inspect

import numpy as np
from sensor_msgs.msg import JointState

import pidtsm_experiments.bags.recorder_node  # noqa: F401
import two_link_sim.simulator_node
import two_link_sim.visualization_node  # noqa: F401
from pidtsm_core.control import Controller
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.experiment.node_settings import resolve_nodes
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.signals import Signal
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_ros.wire import IncomingMessages

values = resolve_nodes(NODE_SCHEMAS, {})
Controller(values["controller"], np.zeros(2), np.zeros((len(Signal), 2))).compile()
SimulatedRobot(values["simulator"]).compile()
ReferenceMotion(values["trajectory"]).evaluate(0.0, np.zeros((3, 2)))
IncomingMessages(JointState, ("position",), ["joint1", "joint2"])

# What else each would do alone: look through all of this for the first line of its log, and through it for what is
# no longer used.
inspect.getmodule(inspect.currentframe())
gc.collect()
gc.freeze()
