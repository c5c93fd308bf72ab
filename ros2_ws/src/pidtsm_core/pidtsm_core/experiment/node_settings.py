"""Checks the parameters of all nodes together: each against its schema, and their joints against each other."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pidtsm_core.parameters import ParameterError, Schema, Value, names, resolve
from pidtsm_core.references import reference_joints
from pidtsm_core.robots import DESCRIPTION, LOCKED, ROBOTS, XACRO, robot_joints

_SHARED = (
    DESCRIPTION.name,
    LOCKED.name,
    XACRO.name,
    "limits.min_position",
    "limits.max_position",
    "limits.velocity",
    "limits.effort",
)
"""Parameters that the trajectory takes from the controller."""
_JOINTS = {"controller": robot_joints, "simulator": robot_joints, "trajectory": reference_joints}


def resolve_nodes(
    schemas: Mapping[str, Schema], settings: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Value]]:
    """Complete and check the parameters of every node; see `resolve`.

    If the joints of the trajectory are not given, they are those of the controller. So are its arm and its limits.

    Args:
        schemas: by node, for the nodes ``controller``, ``simulator`` and ``trajectory``.
        settings: parameters that differ from their defaults, by node.

    Raises:
        ParameterError: an unknown node or parameter, a refused value, or nodes whose joints have different names. The
            message begins with the node if it is known.
    """
    for node in settings:
        if node not in schemas:
            raise ParameterError(f"unknown node {node}; known are {', '.join(schemas)}")
    values: dict[str, dict[str, Value]] = {}
    for node, schema in schemas.items():
        given = dict(settings.get(node, {}))
        with naming(node):
            if node == "trajectory":
                given = {**_of_the_controller(values["controller"], schema, given), **given}
            count = _JOINTS[node](given)
            if node == "trajectory" and "joints" not in settings.get(node, {}) and count != len(given["joints"]):
                raise ParameterError(
                    f"reference.name: this reference moves {count} joints, and the robot has {len(given['joints'])}; "
                    "choose another reference, or a scenario for this robot",
                    "reference.name",
                )
            values[node] = resolve(schema, given, count)
    _check_joints(values)
    return values


@contextmanager
def naming(node: str) -> Iterator[None]:
    """Begin the message about a refused parameter with its node.

    Raises:
        ParameterError: the block has raised it.
    """
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f"{node}: {error}", f"{node}.{error.parameter}") from None


def _of_the_controller(controller: Mapping[str, Value], schema: Schema, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the controller that the trajectory shares, in the order of its joints; none if those differ."""
    joints = names(controller["joints"])
    order = given.get("joints", joints)
    if not isinstance(order, (list, tuple)) or sorted(map(str, order)) != sorted(joints):
        return {}
    shared: dict[str, Any] = {"joints": list(order)}
    known = {parameter.name for parameter in schema(given)}
    for name in known & set(_SHARED) & set(controller):
        value = controller[name]
        shared[name] = [value[joints.index(each)] for each in order] if isinstance(value, tuple) else value
    if tuple(order) != joints and shared.get(DESCRIPTION.name) in ROBOTS:
        del shared[DESCRIPTION.name]  # A closed form has no names by which another order could be known.
    return shared


def _check_joints(values: Mapping[str, Mapping[str, Value]]) -> None:
    """Check that all nodes name the same joints."""
    of_the_controller = names(values["controller"]["joints"])
    for node, resolved in values.items():
        joints = names(resolved["joints"])
        if set(joints) != set(of_the_controller):
            raise ParameterError(
                f"{node}: joints are {', '.join(joints)}; those of the controller are {', '.join(of_the_controller)}. "
                "The nodes match joints by name",
                f"{node}.joints",
            )
