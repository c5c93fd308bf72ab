"""Parameters that only the nodes have, and so the complete schema of each node.

They stand here, without ROS, so that whoever starts nodes can check and complete their parameters beforehand.
"""

from collections.abc import Mapping

from pidtsm_core.controller import ESTIMATOR_NAME, controller_schema
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.parameters import Parameter, ParameterError, Schema, chosen
from pidtsm_core.plant import plant_schema
from pidtsm_core.references import reference_schema

AUTOSTART = Parameter("autostart", True, "configure and activate on start, without a lifecycle manager", fixed=True)

_SIMULATOR = (
    AUTOSTART,
    Parameter(
        "clock",
        "realtime",
        "realtime: samples at the wall clock's rate, stamped with the system time; "
        "lockstep: every sample waits for its command, stamped from 0, with /clock",
        choices=("realtime", "lockstep"),
        fixed=True,
    ),
    Parameter("duration", 0.0, "end after this time; 0 runs for ever", "s", minimum=0.0, fixed=True),
    Parameter(
        "start.subscribers",
        2,
        "subscribers of joint_states to wait for before the first sample (controller, trajectory); 0 starts at once",
        minimum=0,
        fixed=True,
    ),
    Parameter(
        "lockstep.timeout", 5.0, "longest wall time to wait for a command", "s", minimum=0.0, exclusive=True, fixed=True
    ),
)

_CONTROLLER = (
    AUTOSTART,
    Parameter(
        "reference.match",
        "latest",
        "latest: the newest reference, continued to the stamp of the joint state; "
        "stamp: wait for the reference with the stamp of the joint state (lockstep)",
        choices=("latest", "stamp"),
        fixed=True,
    ),
)


def simulator_node_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Every parameter of the simulator node."""
    return (*plant_schema(settings), *_SIMULATOR)


def controller_node_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Every parameter of the controller node.

    Raises:
        ParameterError: an estimator that works in a rollout only.
    """
    estimator = ESTIMATORS[chosen(settings, ESTIMATOR_NAME)]
    if estimator.needs_truth:
        raise ParameterError(
            f"{ESTIMATOR_NAME.name}: {estimator.name} needs the true derivatives, which no sensor delivers; "
            "it works in a rollout only"
        )
    return (*controller_schema(settings), *_CONTROLLER)


def trajectory_node_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Every parameter of the trajectory node."""
    return (*reference_schema(settings), AUTOSTART)


NODE_ONLY = {"simulator": _SIMULATOR, "controller": _CONTROLLER, "trajectory": (AUTOSTART,)}
"""What a rollout does not know, by the name of the node."""

NODE_SCHEMAS: dict[str, Schema] = {
    "simulator": simulator_node_schema,
    "controller": controller_node_schema,
    "trajectory": trajectory_node_schema,
}
"""By the name of the node."""
