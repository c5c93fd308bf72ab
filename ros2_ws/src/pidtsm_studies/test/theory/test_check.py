"""The public check: from Python, along a rollout, a recording or nothing."""

import json

import numpy as np
import pytest

import pidtsm_core
import pidtsm_studies
from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies import check_gains
from pidtsm_studies.theory.tables import bound_rows, condition_rows, lyapunov_sentence, sentences


def test_it_is_public_and_says_what_it_found() -> None:
    assert {"check_gains", "GainCheck"} == set(pidtsm_studies.__all__)
    check = check_gains("case1", duration=0.2, controller={"law.kp": 0.0, "law.ki": 0.0})
    assert repr(check) == "<GainCheck of piddtsm: 8 conditions hold, 1 violated (manifold)>"
    assert [each.name for each in check.violated] == ["manifold"]
    assert pidtsm_core.check_gains is check_gains
    with pytest.raises(AttributeError, match="nothing"):
        _ = pidtsm_studies.nothing


def test_a_good_set_shows_what_is_not_covered() -> None:
    check = check_gains(robot="scara", params="practical", run=False)
    assert not check.violated
    assert [each.name for each in check.not_covered] == ["layer", "bound of the adaptive gain", "finite time"]
    assert check.bounds is None
    assert check.recording is None


def test_json_has_everything_and_no_nan() -> None:
    check = check_gains("case1", duration=0.5)
    read = json.loads(json.dumps(check.to_json(), allow_nan=False))
    assert read["holds"] is True
    assert read["violated"] == []
    assert len(read["conditions"]) == 10
    assert read["conditions"][4]["roots"][0] == pytest.approx(np.array([[-0.585786, 0.0], [-3.414214, 0.0]]), abs=1e-6)
    assert set(read["bounds"]) >= {"disturbance_rate", "gain_needed", "settling", "printed", "lyapunov"}


def test_the_bounds_are_those_of_the_given_run() -> None:
    recording = rollout("case1", duration=0.5)
    along, anew = check_gains("case1", run=recording), check_gains("case1", duration=0.5)
    assert along.bounds is not None
    assert anew.bounds is not None
    assert along.to_json() == anew.to_json()


def test_joints_are_matched_by_name() -> None:
    gains = {"law.kp": [0.0, 2.0], "joints": ["b", "a"]}
    experiment = make_experiment(
        "case1",
        duration=0.2,
        overrides={"controller": gains, "simulator": {"joints": ["a", "b"]}, "trajectory": {"joints": ["a", "b"]}},
    )
    check = check_gains(experiment)
    assert check.joints == ("a", "b")
    assert check.violated[0].joints == (1,)


def test_a_loop_that_diverges_has_no_bounds() -> None:
    check = check_gains("case1", "sliding_mode", controller={"law.k1": 1e12, "limits.effort": 1e15}, duration=0.5)
    assert check.bounds is None or np.isfinite(check.bounds.time).all()
    assert check_gains("case1", "pid", duration=0.1).reason == "no bounds: pid has no sliding variable"


def test_tables_have_each_condition_and_the_bounds_that_exist() -> None:
    check = check_gains("case1", "pidnftsm", duration=1.0, controller={"law.lambda": 1.2})
    rows = condition_rows(check)
    assert [row[-1] for row in rows].count("violated") == 1
    assert check.bounds is not None
    names = [name for name, *_ in bound_rows(check.bounds)]
    assert "gain needed" in names
    assert "sup |u_f|, eq. (13)" not in names  # another surface
    assert sentences(check)[0].startswith("violated: order of the exponents, Van 2018: set law.lambda")
    assert lyapunov_sentence(check.bounds).startswith("V, eq. (35): ")
