"""What a person writes into a field is a value, or is refused; what a page shows can be written again."""

from typing import Any

import pytest
from rcl_interfaces.msg import ParameterDescriptor

from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.parameters import Described, shown, written
from pidtsm_ros.parameters import descriptor


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5", 1.5),
        ("1e-3", 1e-3),
        ("2", 2),
        ("1, 2.5", [1.0, 2.5]),
        ("[1, 2]", [1, 2]),
        ("true", True),
        ("hold", "hold"),
        ("wrist=0.1 elbow=0.2", "wrist=0.1 elbow=0.2"),
    ],
)
def test_a_value_is_read_as_on_the_command_line(text: str, value: Any) -> None:
    assert written(text) == value
    assert type(written(text)) is type(value)


@pytest.mark.parametrize("text", ["", "{a: 1}", "[[1]]: 2", "1, a", "[1", "1, [2]", "*x"])
def test_what_is_no_value_is_refused(text: str) -> None:
    with pytest.raises(RefusedError, match=r"value|not a number"):
        written(text)


@pytest.mark.parametrize("node", NODE_SCHEMAS)
def test_what_is_shown_can_be_written_again(node: str) -> None:
    schema = NODE_SCHEMAS[node]
    parameters = {parameter.name: parameter for parameter in schema({})}
    for name, value in resolve(schema, {}, 2).items():
        described = Described(descriptor(parameters[name]), value)
        assert described.choices == tuple(parameters[name].choices)
        if not isinstance(value, str):
            assert parameters[name].check(written(shown(value)), 2) == value


def test_a_label_has_the_unit_and_a_choice_the_name_of_its_group() -> None:
    described = Described(ParameterDescriptor(name="law.ki", description="integral gain [1/s^2]"), 1.0)
    assert (described.group, described.label) == ("law", "ki [1/s^2]")
    chosen = Described(ParameterDescriptor(name="law.name", additional_constraints="one of a, b; can only ..."), "a")
    assert (chosen.label, chosen.choices) == ("law", ("a", "b"))
