"""What was found is logged once, and again when it has changed."""

from pidtsm_controller.adaptation_watch import AdaptationWatch
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.control.late_drives import Lateness
from pidtsm_core.control.state import Friction, Softness
from pidtsm_core.parameters import resolve

WARNS = {"estimator.name": "extended_state_observer", "adaptation.friction": "warn"}


def test_what_is_certain_is_logged_once_and_again_when_it_has_changed() -> None:
    values = resolve(controller_schema, WARNS, 2)
    controller = Controller(values)
    watch = AdaptationWatch(controller)
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
    assert values_by_name["found friction of joint1, deviation"] == (1.0, "N m")
    assert "found friction of joint2" not in values_by_name  # It is too small to be certain.


def test_lateness_is_logged_once_it_is_sure_and_again_when_it_has_changed() -> None:
    given = {"estimator.name": "extended_state_observer", "adaptation.lateness": "learn"}
    values = resolve(controller_schema, given, 2)
    controller = Controller(values)
    watch, known = AdaptationWatch(controller), controller.state.lateness
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
    assert values_by_name["found lag"] == (0.01, "s")


def watched(softening: str) -> Controller:
    given = {"estimator.name": "extended_state_observer", "adaptation.softening": softening}
    return Controller(resolve(controller_schema, given, 2))


def test_an_arm_that_is_softened_is_logged_and_that_it_is_quiet_again() -> None:
    controller = watched("act")
    watch = AdaptationWatch(controller)
    controller.state.pace[0] = 0.5
    what = "commands were rougher than adaptation.roughness; law and observer have 50 % of their bandwidth"
    assert watch.news() == [f"{what}, softened"]
    assert watch.news() == []
    assert [(reading.name, reading.value) for reading in watch.readings()] == [("found pace", 0.5)]
    controller.state.pace[0] = 1.0
    assert watch.news() == ["law and observer are as before"]
    assert watch.news() == []


def test_a_rough_command_is_logged_once() -> None:
    controller = watched("warn")
    watch = AdaptationWatch(controller)
    for rough in (0.008, 0.001, 0.0081):  # Near the bound it comes and goes.
        controller.state.softness[Softness.ROUGHNESS] = rough, 0.001
        lines = watch.news()
        if rough == 0.008:
            what = "the command changes by 0.8 % of its limit from sample to sample, more than adaptation.roughness"
            assert lines == [f"joint1: {what}, not softened (adaptation.softening: warn)"]
        else:
            assert lines == []
