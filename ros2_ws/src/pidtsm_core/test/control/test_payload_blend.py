"""Taking over a payload makes no step of the torque, and ends with the model of that payload."""

from typing import Any

import numpy as np

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.payload_blend import DURATION, PayloadBlend
from pidtsm_core.parameters import resolve
from pidtsm_core.robots.payload import Payload

ARM = {"robot.description": "ur5", "estimator.name": "extended_state_observer", "law.disturbance_rejection": True}
CARRIED = Payload(3.0, np.array([0.0, 0.02, 0.05]))
PERIOD = 1_000_000


def built(**payload: Any) -> Controller:
    values = resolve(controller_schema, {**ARM, **{f"payload.{name}": v for name, v in payload.items()}}, 6)
    controller = Controller(values)
    controller.compile()
    controller.position[:] = [0.0, -1.0, 1.0, 0.3, 0.2, 0.1]
    controller.reference[0] = controller.position
    return controller


def test_the_torque_has_no_step_and_ends_as_if_the_payload_had_been_known() -> None:
    values = resolve(controller_schema, ARM, 6)
    controller, informed = built(), built(mass=CARRIED.mass, center_of_mass=list(CARRIED.center_of_mass))
    efforts = []
    blend = None
    for k in range(1200):
        for each in (controller, informed):
            each.step(k * PERIOD, k * PERIOD)
        efforts.append(controller.effort.copy())
        if k == 100:
            blend = PayloadBlend(controller, values, CARRIED)
        if blend is not None:
            blend.advance(PERIOD / 1e9)
    assert blend is not None
    assert blend.done
    np.testing.assert_allclose(controller.config.model.parameters[:150], informed.config.model.parameters[:150])
    steps = np.abs(np.diff(efforts[50:], axis=0))
    assert np.abs(efforts[-1] - efforts[100]).max() > 5.0
    assert steps.max() < 0.1


def test_another_change_of_the_parameters_does_not_interrupt_it() -> None:
    values = resolve(controller_schema, ARM, 6)
    controller = built()
    blend = PayloadBlend(controller, values, CARRIED)
    blend.advance(0.5 * DURATION)
    half = controller.config.model.parameters.copy()
    controller.set_parameters(values)
    assert (controller.config.model.parameters != half).any()
    blend.advance(0.0)
    np.testing.assert_array_equal(controller.config.model.parameters, half)
