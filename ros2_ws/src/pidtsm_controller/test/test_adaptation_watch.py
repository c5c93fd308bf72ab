"""What was found is logged once, and again when it has changed."""

import numpy as np

from pidtsm_controller.adaptation_watch import AdaptationWatch
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.state import Friction, Lateness
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot

WARNS = {"estimator.name": "extended_state_observer", "adaptation.friction": "warn"}


def test_what_is_certain_is_logged_once_and_again_when_it_has_changed() -> None:
    values = resolve(controller_schema, WARNS, 2)
    controller, robot = Controller(values), find_robot(values)
    watch = AdaptationWatch(controller, robot.joints, robot.units)
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


def test_lateness_is_logged_once_it_is_sure_and_again_when_it_has_changed() -> None:
    given = {"estimator.name": "extended_state_observer", "adaptation.lateness": "learn"}
    values = resolve(controller_schema, given, 2)
    controller, robot = Controller(values), find_robot(values)
    watch, known = AdaptationWatch(controller, robot.joints, robot.units), controller.state.lateness
    known[[Lateness.FOUND_DELAY, Lateness.FOUND_LAG, Lateness.DEVIATION]] = 0.02, 0.01, 0.004
    assert watch.news() == []
    assert watch.readings() == []
    known[Lateness.LATE] = 1.0
    line = "the drives are 30 ± 4 ms later than drive.delay and drive.lag (delay 20 ms, lag 10 ms), compensated"
    assert watch.news() == [line]
    assert watch.news() == []
    known[Lateness.FOUND_DELAY] = 0.03
    assert [news[:23] for news in watch.news()] == ["the drives are 40 ± 4 m"]
    values_by_name = {reading.name: (reading.value, reading.unit) for reading in watch.readings()}
    assert values_by_name["lag of the drives found"] == (0.01, "s")
