"""A payload at the tool: the dynamics of an arm with one more body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters import ParameterError, Schema, resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.robots import find_robot, payload_of, tree
from pidtsm_core.robots.source import read_source
from pidtsm_core.simulation.plant import plant_schema
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

MS = 1_000_000
CENTER, INERTIA = (0.03, -0.02, 0.08), (0.004, 0.005, 0.003, 0.0004, -0.0002, 0.0003)
BODY = (
    '<link name="load"><inertial><origin xyz="{} {} {}"/><mass value="1.7"/>'
    '<inertia ixx="{}" iyy="{}" izz="{}" ixy="{}" ixz="{}" iyz="{}"/></inertial></link>'
    '<joint name="grip" type="fixed"><parent link="tool"/><child link="load"/></joint></robot>'
).format(*CENTER, *INERTIA)
LOADED = {"payload.mass": 1.7, "payload.center_of_mass": CENTER, "payload.inertia": INERTIA}


@pytest.mark.parametrize("arm", ["panda", "scara"])
@pytest.mark.parametrize("schema", [plant_schema, controller_schema])
def test_it_is_a_body_that_is_fixed_to_the_tool(schema: Schema, arm: str) -> None:
    robot = find_robot({"robot.description": arm})
    n, random = len(robot.joints), np.random.default_rng(0)
    values = resolve(schema, {"robot.description": arm, **LOADED}, n)
    loaded = robot.with_payload(robot.pack_model(values), payload_of(values))
    text = read_source(arm)[1].replace("</robot>", BODY)
    other = find_robot({"robot.description": text})
    fixed = other.pack_model(resolve(plant_schema, {"robot.description": text}, n))
    for q, dq, ddq in random.uniform(-2.0, 2.0, (20, 3, n)):
        efforts = np.zeros((2, 1, n))
        for p, effort in zip((loaded, fixed), efforts, strict=True):
            tree.inverse_dynamics(q, dq, ddq[np.newaxis], p, effort)
        np.testing.assert_allclose(efforts[0], efforts[1], rtol=1e-11, atol=1e-11)


@given(a=st.floats(0.01, 1.0), b=st.floats(0.01, 1.0), excess=st.floats(1e-6, 10.0))
def test_an_inertia_that_no_body_has_is_refused(a: float, b: float, excess: float) -> None:
    for inertia in ((a, b, (a + b) * (1.0 + excess), 0, 0, 0), (a, b, abs(a - b) - excess * (a + b), 0, 0, 0)):
        with pytest.raises(ParameterError, match=r"payload\.inertia"):
            resolve(plant_schema, {"robot.description": "panda", "payload.inertia": inertia}, 7)


@pytest.mark.parametrize("value", [0.1, [0.1, 0.2], [0.1, 0.2, 0.3, 0.4], "here", [0.0, 0.0, float("nan")]])
def test_a_centre_of_mass_has_three_finite_coordinates(value: object) -> None:
    with pytest.raises(ParameterError, match=r"payload\.center_of_mass"):
        resolve(plant_schema, {"robot.description": "panda", "payload.center_of_mass": value}, 7)


def test_the_load_of_a_closed_form_is_a_point() -> None:
    with pytest.raises(ParameterError, match="unknown parameter"):
        resolve(plant_schema, {"payload.center_of_mass": CENTER}, 2)


@pytest.mark.parametrize("known", [False, True])
def test_a_load_is_picked_up_changed_and_dropped_while_the_arm_moves(known: bool) -> None:
    settings = make_experiment(None, law="computed_torque", robot="panda").settings
    controller = {**settings["controller"], "estimator.name": "extended_state_observer"}
    simulator = settings["simulator"]
    names = list(find_robot(controller).joints)
    control = Controller(resolve(controller_schema, controller, 7))
    robot = SimulatedRobot(resolve(simulator_schema, simulator, 7))
    motion = ReferenceMotion(resolve(reference_schema, {**settings["trajectory"], "joints": names}, 7))
    loads = {500: LOADED, 1000: {**LOADED, "payload.mass": 0.6}, 1500: {}}
    errors = np.zeros((2000, 7))
    for k in range(2000):
        if k in loads:
            robot.set_parameters(resolve(simulator_schema, {**simulator, **loads[k]}, 7))
            if known:
                control.set_parameters(resolve(controller_schema, {**controller, **loads[k]}, 7))
        motion.evaluate(k * 1e-3, control.reference)
        control.position[:] = robot.state.arm.position
        errors[k] = control.position - control.reference[0]
        control.step(1 + k * MS, 1 + k * MS)
        robot.act(k, True, control.effort)
    worst = np.abs(errors[500:]).max()
    assert worst < 2e-3 if known else worst > 5e-3
