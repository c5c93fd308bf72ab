"""What was found is logged once, and again when it has changed."""

import numpy as np

from pidtsm_controller.friction_watch import FrictionWatch
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.state import Friction
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot

WARNS = {"estimator.name": "extended_state_observer", "adaptation.friction": "warn"}


def test_what_is_certain_is_logged_once_and_again_when_it_has_changed() -> None:
    values = resolve(controller_schema, WARNS, 2)
    controller, robot = Controller(values), find_robot(values)
    watch = FrictionWatch(controller, robot.joints, robot.units)
    assert watch.news() == []
    known = controller.state.friction
    known[Friction.EVIDENCE] = 1.0
    known[Friction.COULOMB], known[Friction.DEVIATION] = [5.0, 0.05], [1.0, 0.0]
    assert watch.news() == [
        "joint1: found 5 ± 1 N m of friction beyond compensation.coulomb, not compensated (adaptation.friction: warn)"
    ]
    assert watch.news() == []
    known[Friction.COULOMB] *= 1.1
    assert watch.news() == []
    known[Friction.COULOMB] *= 2.0
    assert [line[:21] for line in watch.news()] == ["joint1: found 11 ± 1 "]
    values_by_name = {reading.name: (reading.value, reading.unit) for reading in watch.readings()}
    assert values_by_name["deviation of the friction of joint1"] == (1.0, "N m")
    np.testing.assert_allclose(values_by_name["friction found of joint2"][0], 0.05 * 1.1 * 2.0)
