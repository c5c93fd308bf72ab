"""Declares the parameters of a schema of `pidtsm_core` as ROS parameters, and lets them be set."""

import math
from collections.abc import Callable, Mapping

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter_service import ParameterService

from pidtsm_core.parameters import Parameter, Schema, Value, resolve
from pidtsm_core.robots import DESCRIPTION, FROM_TOPIC, OF_ARM, TreeRobot, find_robot
from pidtsm_core.robots.definition import joints_sentence
from pidtsm_ros.robot_description import receive_description
from pidtsm_ros.stop import Stop

_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(node: Node, schema: Schema, joints: Callable[[Mapping[str, object]], int], stop: Stop) -> dict[str, Value]:
    """Declare the parameters of a node.

    Args:
        node: the node.
        schema: returns all parameters of the node for given settings.
        joints: returns the number of joints for given settings.
        stop: ends the wait for a robot description.

    Returns:
        Their checked values by name.

    Raises:
        ParameterError: a parameter set at startup is unknown or has an invalid value.
        SystemExit: see `receive_description`.
    """
    # rclpy has no public access to values given for undeclared parameters; it ignores them silently.
    overrides = node._parameter_overrides
    given = {name: p.value for name, p in overrides.items() if not name.startswith(_OF_ROS)}
    if given.get(DESCRIPTION.name) == FROM_TOPIC:
        given[DESCRIPTION.name] = receive_description(node, stop)
    values = resolve(schema, given, joints(given))
    _report_gripper(node, given)
    for parameter in schema(given):
        value = values[parameter.name]
        node.declare_parameter(
            parameter.name,
            list(value) if isinstance(value, tuple) else value,
            descriptor(parameter),
            ignore_override=True,
        )
    return values


def _report_gripper(node: Node, given: Mapping[str, object]) -> None:
    """Log which joints were recognised as a gripper, and locked, because the parameter ``joints`` is not set."""
    if "joints" in given or not given.get(DESCRIPTION.name):
        return
    robot = find_robot({name: value for name, value in given.items() if name in OF_ARM})
    if isinstance(robot, TreeRobot) and robot.description.grippers:
        node.get_logger().info(joints_sentence(robot.description, "the parameters joints and robot.locked"))


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Descriptor of a parameter, as shown by ``ros2 param describe``."""
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    constraints = [parameter.range_text()]
    if parameter.per_joint and not isinstance(parameter.default, tuple):
        constraints.append("one number for all joints, or one per joint")
    if parameter.read_only:
        constraints.append("can only be set at startup")
    described = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description + unit,
        additional_constraints="; ".join(c for c in constraints if c),
        read_only=parameter.read_only,
        # Allows one number for all joints, and an integer for a float; the schema checks the rest.
        dynamic_typing=isinstance(parameter.default, (float, tuple)),
    )
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return described
    if isinstance(parameter.default, int):
        top = 2**62 if high is None else int(high)
        described.integer_range = [IntegerRange(from_value=int(low or 0), to_value=top, step=0)]
    else:
        described.floating_point_range = [
            FloatingPointRange(
                from_value=-math.inf if low is None else low, to_value=math.inf if high is None else high, step=0.0
            )
        ]
    return described


class CheckedParameterService(ParameterService):
    """Rejects values of an unknown type; rclpy's own service raises an exception, which ends the executor.

    It also names a parameter that does not exist; rclpy's own service does not.
    """

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        for parameter in request.parameters:
            alone = SetParametersAtomically.Request(parameters=[parameter])
            answer = self._set_parameters_atomically_callback(alone, SetParametersAtomically.Response())
            response.results.append(answer.result)
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        try:
            self._get_node().check_names(parameter.name for parameter in request.parameters)
            return super()._set_parameters_atomically_callback(request, response)
        except ValueError as error:
            response.result = SetParametersResult(successful=False, reason=str(error))
            return response
