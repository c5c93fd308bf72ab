"""Values that a parameter accepts or refuses, and properties of every schema of the project."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS, SCHEMAS
from pidtsm_core.parameters import (
    Parameter,
    ParameterError,
    Schema,
    chosen,
    joint_array,
    prefixed,
    resolve,
    unknown_parameter,
)
from pidtsm_core.references import reference_joints
from pidtsm_core.robots import robot_joints

PROPERTY = settings(deadline=None, max_examples=100)

GAIN = Parameter("law.gain", 2.0, "a gain", "1/s", minimum=0.0, maximum=10.0, per_joint=True)
POSITIVE = Parameter("mass", 1.0, "a mass", "kg", minimum=0.0, maximum=5.0, exclusive=True)
COUNT = Parameter("rate", 1000, "samples a second", "Hz", minimum=1, maximum=5000)
SWITCH = Parameter("autostart", True, "start at once")
CHOICE = Parameter("law.name", "piddtsm", "control law", choices=("piddtsm", "dtsm", "sliding_mode"))
TEXT = Parameter("title", "run", "any text")
NAMES = Parameter("joints", ("joint1", "joint2"), "names")
EACH = Parameter("limits.effort", (100.0, 50.0), "limits", "N m", minimum=0.0, exclusive=True, per_joint=True)


@pytest.mark.parametrize("value", [10**400, -(10**400), 2**64, 1e300, [[1.0], [2.0, 3.0]], [10**400, 1.0]])
def test_values_that_are_no_usable_numbers_are_refused(value: object) -> None:
    with pytest.raises(ParameterError, match=r"must be|is absurd"):
        Parameter("gain", 1.0, "a gain", per_joint=True).check(value, 2)


@pytest.mark.parametrize(
    ("parameter", "given_value", "result"),
    [
        (GAIN, 3, 3.0),
        (GAIN, 0.0, 0.0),
        (GAIN, 10, 10.0),
        (GAIN, [1, 2.5], (1.0, 2.5)),
        (GAIN, (1.0, 2.0), (1.0, 2.0)),
        (GAIN, np.array([1.0, 2.0]), (1.0, 2.0)),
        (GAIN, np.array([1, 2]), (1.0, 2.0)),
        (GAIN, [4.0], 4.0),
        (GAIN, np.float64(1.5), 1.5),
        (GAIN, np.int64(3), 3.0),
        (POSITIVE, 1e-300, 1e-300),
        (COUNT, 1, 1),
        (COUNT, 500.0, 500),
        (SWITCH, False, False),
        (SWITCH, np.True_, True),
        (CHOICE, "dtsm", "dtsm"),
        (TEXT, "", ""),
        (NAMES, ["a", "b", "c"], ("a", "b", "c")),
        (EACH, (100.0, 50.0), (100.0, 50.0)),
        (EACH, 7, 7.0),
    ],
    ids=lambda v: v.name if isinstance(v, Parameter) else repr(v),
)
def test_check_returns_the_value_in_the_type_of_the_parameter(
    parameter: Parameter, given_value: object, result: object
) -> None:
    checked = parameter.check(given_value, 2)
    assert checked == result
    assert type(checked) is type(result)
    if isinstance(checked, tuple) and isinstance(result, tuple):
        assert [type(v) for v in checked] == [type(v) for v in result]


@pytest.mark.parametrize(
    ("parameter", "value", "reason"),
    [
        (GAIN, -0.001, r">= 0 and <= 10"),
        (GAIN, 10.001, r">= 0 and <= 10"),
        (GAIN, [1.0, 11.0], r">= 0 and <= 10"),
        (GAIN, float("nan"), "finite"),
        (GAIN, float("inf"), "finite"),
        (GAIN, [1.0, float("-inf")], "finite"),
        (GAIN, np.array([1.0, np.nan]), "finite"),
        (GAIN, True, "number"),
        (GAIN, [1.0, True], "number"),
        (GAIN, "3", "number"),
        (GAIN, None, "number"),
        (GAIN, [], "one number, or one for each of the 2 joints"),
        (GAIN, [1.0, 2.0, 3.0], "one number, or one for each of the 2 joints"),
        (GAIN, [[1.0], [2.0]], "number"),
        (POSITIVE, 0.0, r"> 0 and < 5"),
        (POSITIVE, 5.0, r"> 0 and < 5"),
        (POSITIVE, [1.0], "single"),
        (COUNT, 0, r">= 1 and <= 5000"),
        (COUNT, 1.5, "integer"),
        (COUNT, float("nan"), "finite|whole"),
        (COUNT, float("inf"), "finite|whole"),
        (COUNT, True, "number"),
        (SWITCH, 1, "true or false"),
        (SWITCH, "true", "true or false"),
        (CHOICE, "piddtms", r"did you mean piddtsm\?"),
        (CHOICE, "xyz", "one of piddtsm, dtsm, sliding_mode"),
        (CHOICE, 3, "text"),
        (TEXT, 3.0, "text"),
        (TEXT, ["a"], "single"),
        (NAMES, [], "non-empty"),
        (NAMES, "joint1", "non-empty list of names"),
        (NAMES, ["a", ""], "non-empty list of names"),
        (NAMES, ["a", 1], "non-empty list of names"),
        (NAMES, ["a", "a"], "twice"),
        (EACH, [1.0, 0.0], "> 0"),
        (EACH, [1.0, 2.0, 3.0], "2 joints"),
    ],
    ids=lambda v: v.name if isinstance(v, Parameter) else repr(v),
)
def test_check_refuses_with_the_name_and_the_reason(parameter: Parameter, value: object, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason) as caught:
        parameter.check(value, 2)
    assert str(caught.value).startswith(parameter.name)
    assert parameter.unit in str(caught.value)


@PROPERTY
@given(st.floats() | st.integers() | st.booleans() | st.text() | st.none() | st.lists(st.floats(), max_size=3))
def test_check_accepts_exactly_the_range_and_refuses_with_its_own_error(value: object) -> None:
    members = value if isinstance(value, list) else [value]
    expected = len(members) in (1, 2) and all(
        isinstance(v, (int, float)) and not isinstance(v, bool) and 0.0 <= v <= 10.0 for v in members
    )
    try:
        checked = GAIN.check(value, 2)
    except ParameterError:
        assert not expected
    else:
        assert expected
        assert GAIN.check(checked, 2) == checked


@PROPERTY
@given(st.floats() | st.integers())
def test_a_whole_number_is_one_or_is_refused(value: float) -> None:
    try:
        checked = COUNT.check(value, 2)
    except ParameterError:
        assert not (1 <= value <= 5000 and value == int(value))
    else:
        assert isinstance(checked, int)
        assert checked == value
        assert 1 <= checked <= 5000


def _schema(settings: object) -> tuple[Parameter, ...]:
    return (GAIN, POSITIVE, CHOICE)


def test_resolve_fills_in_defaults() -> None:
    assert resolve(_schema, {"law.gain": [1, 2]}, 2) == {"law.gain": (1.0, 2.0), "mass": 1.0, "law.name": "piddtsm"}


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("law.gian", r"unknown parameter law\.gian; did you mean law\.gain\?"),
        ("nothing", r"unknown parameter nothing; known: law\.gain, law\.name, mass"),
    ],
)
def test_resolve_refuses_an_unknown_name(name: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        resolve(_schema, {name: 1.0}, 2)
    assert re.search(reason, unknown_parameter(name, ["mass", "law.name", "law.gain"]))


def test_resolve_refuses_a_bad_value() -> None:
    with pytest.raises(ParameterError, match="mass"):
        resolve(_schema, {"mass": 0.0}, 2)


def test_chosen_is_the_default_or_a_checked_choice() -> None:
    assert chosen({}, CHOICE) == "piddtsm"
    assert chosen({"law.name": "dtsm"}, CHOICE) == "dtsm"
    with pytest.raises(ParameterError, match="did you mean dtsm"):
        chosen({"law.name": "dtms"}, CHOICE)


def test_prefixed_changes_names_only() -> None:
    (renamed,) = prefixed("robot", [POSITIVE])
    assert renamed.name == "robot.mass"
    assert renamed.check(2, 2) == 2.0
    assert (renamed.description, renamed.unit, renamed.minimum, renamed.exclusive) == ("a mass", "kg", 0.0, True)


@pytest.mark.parametrize("value", [2.0, (2.0, 2.0, 2.0)])
def test_joint_array_has_one_writable_float_a_joint(value: object) -> None:
    array = joint_array(value, 3)  # type: ignore[arg-type]
    assert array.shape == (3,)
    assert array.dtype == np.float64
    array[0] = 1.0
    assert array.tolist() == [1.0, 2.0, 2.0]


# Every schema of the project, for every choice that adds parameters.


def _variants(schema: Schema, given_settings: dict[str, object], seen: set[str]) -> Iterator[dict[str, object]]:
    """The settings themselves, and with every choice of every parameter that they add."""
    try:
        parameters = schema(given_settings)
    except ParameterError:
        return  # A node refuses choices that work only in a rollout.
    yield given_settings
    fresh = [p for p in parameters if p.name not in seen]
    seen = seen | {p.name for p in fresh}
    for parameter in fresh:
        for choice in parameter.choices:
            if choice != parameter.default:
                yield from _variants(schema, {**given_settings, parameter.name: choice}, seen)


ALL = [
    pytest.param(schema, variant, id=f"{kind}-{node}-{'-'.join(map(str, variant.values())) or 'defaults'}")
    for kind, schemas in (("core", SCHEMAS), ("node", NODE_SCHEMAS))
    for node, schema in schemas.items()
    for variant in _variants(schema, {}, set())
]


def joints_of(variant: dict[str, object]) -> int:
    return reference_joints(variant) if "reference.name" in variant else robot_joints(variant)


@pytest.mark.parametrize(("schema", "variant"), ALL)
def test_schema_names_are_unique_and_fit_for_ros(schema: Schema, variant: dict[str, object]) -> None:
    names = [p.name for p in schema(variant)]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*", name) for name in names)
    groups = {name.rpartition(".")[0] for name in names} - {""}
    assert not groups & set(names), "a name that is also a group cannot stand in a parameter file"


@pytest.mark.parametrize(("schema", "variant"), ALL)
def test_schema_describes_every_parameter_and_its_default_passes_its_own_check(
    schema: Schema, variant: dict[str, object]
) -> None:
    joints = joints_of(variant)
    for parameter in schema(variant):
        assert parameter.description.strip(), parameter.name
        checked = parameter.check(parameter.default, joints)
        assert checked == parameter.default, parameter.name
        assert parameter.check(checked, joints) == checked
        if parameter.choices:
            assert parameter.default in parameter.choices


@pytest.mark.parametrize(("schema", "variant"), ALL)
def test_resolving_what_was_resolved_changes_nothing(schema: Schema, variant: dict[str, object]) -> None:
    joints = joints_of(variant)
    values = resolve(schema, variant, joints)
    assert set(values) == {p.name for p in schema(variant)}
    assert {**values, **variant} == values
    assert resolve(schema, values, joints) == values


@pytest.mark.parametrize("schema", NODE_SCHEMAS.values(), ids=NODE_SCHEMAS.keys())
def test_names_of_joints_must_be_as_many_as_the_joints(schema: Schema) -> None:
    joints = joints_of({p.name: p.default for p in schema({})})
    names = tuple(f"axis{j}" for j in range(joints + 1))
    assert resolve(schema, {"joints": names[:joints]}, joints)["joints"] == names[:joints]
    for wrong in (names[:1], names):
        with pytest.raises(ParameterError, match="joints"):
            resolve(schema, {"joints": wrong}, joints)
