"""The gains of every law on every arm start within bounds that theory gives."""

import numpy as np
import pytest

from pidtsm_core.experiment import practical_settings
from pidtsm_core.laws import LAWS
from pidtsm_core.robots import NAMES
from pidtsm_studies.score.tasks import find_task
from pidtsm_studies.tuning.space import Space, make_space


@pytest.mark.parametrize("robot", NAMES)
@pytest.mark.parametrize("law", LAWS.names)
def test_start_and_bounds_are_allowed(robot: str, law: str) -> None:
    task = find_task(robot)
    space = make_space(task, law)
    assert ((space.start >= 0.0) & (space.start <= 1.0)).all()
    nominal = task.experiment(law)
    for x in (np.zeros_like(space.start), space.start, np.ones_like(space.start)):
        settings = {**nominal.settings, "controller": space.controller(x)}
        overrides = [f"controller.{name}={value}" for name, value in settings["controller"].items()]
        task.experiment(None, (), overrides)


@pytest.mark.parametrize("robot", ["two_link", "panda"])
def test_the_proposed_law_starts_with_the_rule_based_set(robot: str) -> None:
    task = find_task(robot)
    rule = practical_settings(None, task.experiment(None).settings)["controller"]
    space = make_space(task, "piddtsm")
    start = space.controller(space.start)
    for name, value in rule.items():
        if name != "law.anti_windup":
            assert np.allclose(start[name], value) if isinstance(value, (float, list, tuple)) else start[name] == value


def test_two_joints_are_tuned_separately_and_seven_by_a_factor() -> None:
    two, seven = (make_space(find_task(robot), "piddtsm") for robot in ("two_link", "panda"))
    labels = [each.label for each in two.variables]
    assert {"law.k1, joint 1", "law.k1, joint 2", "law.alpha"} <= set(labels)
    place = [each.label for each in seven.variables].index("law.kp")
    x = seven.start.copy()
    x[place] = seven.variables[place].place(2.0 * seven.variables[place].value)
    first, second = (np.array(seven.controller(each)["law.kp"]) for each in (seven.start, x))
    np.testing.assert_allclose(second, 2.0 * first, rtol=1e-3)


def test_theory_bounds_the_exponents() -> None:
    def bounds(law: str) -> dict[str, tuple[float, float]]:
        space: Space = make_space(find_task(), law)
        return {each.name: (each.low, each.high) for each in space.variables}

    assert 0.0 < bounds("piddtsm")["law.alpha"][0] < bounds("piddtsm")["law.alpha"][1] < 1.0
    found = bounds("pidnftsm")
    assert 1.0 < found["law.p_over_q"][0] < found["law.p_over_q"][1] < found["law.lambda"][0]
