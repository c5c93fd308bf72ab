"""Bad parameters: at the start one line and exit code 2; while running refused, the old value kept."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from support.testbed import Testbed

BAD_AT_START = [
    ("controller", "law.k1:=-3.0", "law.k1: -3.0 must be >= 0"),
    ("controller", "law.k1:=[1.0, 2.0, 3.0]", "must be one number, or one for each of the 2 joints"),
    ("controller", "law.kk:=1.0", "unknown parameter law.kk; did you mean law.k?"),
    ("controller", "law.alpha:=.nan", "law.alpha: nan must be finite"),
    ("controller", "law.kd:=fast", "law.kd: 'fast' must be a number"),
    ("controller", "law.name:=pidtsm", "law.name: 'pidtsm' must be one of"),
    ("controller", "estimator.name:=exact", "exact needs the true derivatives"),
    ("controller", "joints:=[joint1]", "must contain 2 joint names"),
    ("simulator", "rate:=0", "rate (Hz): 0 must be >= 1"),
    ("simulator", "clock:=sundial", "clock: 'sundial' must be one of realtime, lockstep"),
    ("simulator", "robot.r1:=0.0", "robot.r1 (m): 0.0 must be > 0"),
    ("trajectory", "reference.name:=circle", "reference.name: 'circle' must be one of"),
    ("recorder", "max_bag_size:=-1", "max_bag_size out of range"),
    ("visualization", "robot.description:=3", "robot.description: 3 must be text"),
]


@pytest.mark.parametrize(("node", "parameter", "cause"), BAD_AT_START)
def test_bad_parameter_at_the_start_is_one_line(testbed: Testbed, node: str, parameter: str, cause: str) -> None:
    process = testbed.start(node, parameter)
    assert process.wait() == 2
    lines = process.log.read_text().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("cannot start: ")
    assert cause in lines[0]


def test_arguments_that_ros_cannot_read_are_one_line(testbed: Testbed) -> None:
    process = testbed.start("visualization", "no_value")
    assert process.wait() == 2
    lines = [line for line in process.log.read_text().splitlines() if "[rcl]" not in line]
    assert len(lines) == 1
    assert lines[0].startswith("cannot start: ")
    assert "Couldn't parse parameter override rule: '-p no_value'" in lines[0]


def double(name: str, value: float) -> Parameter:
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))


def text(name: str, value: str) -> Parameter:
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value))


def test_running_controller_keeps_its_gains_when_one_is_bad(testbed: Testbed) -> None:
    testbed.start("controller")

    def set_parameters(*parameters: Parameter) -> tuple[bool, str]:
        request = SetParametersAtomically.Request(parameters=list(parameters))
        result = testbed.call(SetParametersAtomically, "controller/set_parameters_atomically", request).result
        return result.successful, result.reason

    def get(*names: str) -> list[float]:
        values = testbed.call(
            GetParameters, "controller/get_parameters", GetParameters.Request(names=list(names))
        ).values
        return [value.double_value for value in values]

    assert set_parameters(double("law.k1", 4.0), double("law.k2", 0.6)) == (True, "")
    assert get("law.k1", "law.k2") == [4.0, 0.6]

    for bad, cause in (
        (double("law.k2", -1.0), "law.k2"),
        (double("law.alpha", 1.0), "law.alpha: 1.0 must be > 0 and < 1"),
        (double("law.kd", float("nan")), "law.kd"),
        (text("law.kp", "high"), "law.kp (1/s): 'high' must be a number"),
        (text("law.anti_windup", "maybe"), "law.anti_windup: 'maybe' must be one of conditional, none"),
        (text("law.name", "sliding_mode"), "read-only"),
    ):
        successful, reason = set_parameters(double("law.k1", 5.0), bad)
        assert not successful
        assert cause in reason
        assert get("law.k1", "law.k2") == [4.0, 0.6], "a set is taken whole or not at all"


def test_setting_a_parameter_that_does_not_exist_names_it(testbed: Testbed) -> None:
    testbed.start("controller")

    def set_parameters(*parameters: Parameter) -> list[tuple[bool, str]]:
        request = SetParameters.Request(parameters=list(parameters))
        results = testbed.call(SetParameters, "controller/set_parameters", request).results
        return [(result.successful, result.reason) for result in results]

    known, typo = double("law.k1", 4.0), double("law.kk", 1.0)
    unset = Parameter(name="nonsense")
    assert set_parameters(typo, known) == [(False, "unknown parameter law.kk; did you mean law.k?"), (True, "")]
    assert set_parameters(double("law.gain", 1.0))[0][1].startswith("unknown parameter law.gain: ")
    assert set_parameters(unset)[0][1].startswith("unknown parameter nonsense; known: ")
    request = SetParametersAtomically.Request(parameters=[known, typo])
    result = testbed.call(SetParametersAtomically, "controller/set_parameters_atomically", request).result
    assert (result.successful, result.reason) == (False, "unknown parameter law.kk; did you mean law.k?")


@pytest.mark.parametrize("node", ["simulator", "controller", "trajectory"])
def test_every_parameter_describes_itself(testbed: Testbed, node: str) -> None:
    from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS

    testbed.start(node)
    schema = NODE_SCHEMAS[node]({})
    request = DescribeParameters.Request(names=[p.name for p in schema])
    descriptors = testbed.call(DescribeParameters, f"{node}/describe_parameters", request).descriptors
    for parameter, descriptor in zip(schema, descriptors, strict=True):
        assert descriptor.description.startswith(parameter.description)
        assert parameter.unit in descriptor.description
        assert descriptor.read_only == parameter.read_only
        assert parameter.range_text() in descriptor.additional_constraints
