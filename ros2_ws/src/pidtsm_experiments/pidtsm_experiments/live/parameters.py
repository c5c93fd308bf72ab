"""Parameters of a node as in its descriptors, and values as a person writes them."""

from collections.abc import Awaitable, Callable
from typing import Any, NamedTuple

import yaml
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from pidtsm_core.parameters.files import read_yaml
from pidtsm_experiments.live.errors import RefusedError

_CHOICES = "one of "
_READINGS = 5  # of a node that is started again meanwhile


class Described(NamedTuple):
    """One parameter of a node."""

    descriptor: ParameterDescriptor
    value: Any

    @property
    def name(self) -> str:
        """Full name, such as ``law.k1``."""
        return str(self.descriptor.name)

    @property
    def group(self) -> str:
        """What precedes the last dot of the name; empty: nothing."""
        return self.name.rpartition(".")[0]

    @property
    def label(self) -> str:
        """The last part of the name, and the unit; for a choice such as ``law.name``, the group."""
        group, _, last = self.name.rpartition(".")
        _, bracket, unit = self.descriptor.description.rpartition(" [")
        return (group if last == "name" else last) + (f" [{unit}" if bracket else "")

    @property
    def hint(self) -> str:
        """Meaning, unit and range."""
        constraints = self.descriptor.additional_constraints
        return self.descriptor.description + (f" ({constraints})" if constraints else "")

    @property
    def choices(self) -> tuple[str, ...]:
        """The allowed values of a text; empty if any is."""
        first = self.descriptor.additional_constraints.partition(";")[0]
        return tuple(first.removeprefix(_CHOICES).split(", ")) if first.startswith(_CHOICES) else ()


def plain(value: ParameterValue) -> Any:
    """The value of a parameter; a list as a tuple."""
    python = parameter_value_to_python(value)
    return tuple(python) if hasattr(python, "__iter__") and not isinstance(python, str) else python


def shown(value: Any) -> str:
    """A value as `written` reads it: numbers of several joints are separated by commas."""
    if isinstance(value, (str, bool)):
        return str(value)
    if hasattr(value, "__iter__"):
        return ", ".join(shown(each) for each in value)
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def written(text: str) -> Any:
    """The value that a person has written: as in ``--set``, and the brackets of a list may be left out.

    Raises:
        RefusedError: the text is not a value.
    """
    try:
        value = read_yaml(f"[{text}]" if "," in text and not text.lstrip().startswith("[") else text)
    except yaml.YAMLError:
        raise RefusedError(f"{text!r} is not a value") from None
    if isinstance(value, list) and any(isinstance(each, float) for each in value):
        # ROS has no lists of both integers and floats.
        value = [float(each) if isinstance(each, int) and not isinstance(each, bool) else each for each in value]
    if value is None or isinstance(value, dict) or (isinstance(value, list) and len({type(v) for v in value}) != 1):
        raise RefusedError(f"{text!r} is not a number, a text, or a list of either")
    return value


async def read_parameters(call: Callable[[Any, str, Any], Awaitable[Any]], node: str) -> list[Described]:
    """Every parameter of a node.

    Args:
        call: calls a service: its type, its name, and the request.
        node: the node.

    Raises:
        RefusedError: the node has other parameters at each answer, or `call` raises it.
    """
    for _ in range(_READINGS):
        listed = await call(ListParameters, f"{node}/list_parameters", ListParameters.Request())
        names = sorted(listed.result.names)
        known = await call(DescribeParameters, f"{node}/describe_parameters", DescribeParameters.Request(names=names))
        got = await call(GetParameters, f"{node}/get_parameters", GetParameters.Request(names=names))
        # A node that was started anew meanwhile answers nothing if it does not know one of the names.
        if len(known.descriptors) == len(got.values) == len(names):
            return list(map(Described, known.descriptors, map(plain, got.values)))
    raise RefusedError(f"the parameters of {node} changed whenever they were read; is it started again and again?")
