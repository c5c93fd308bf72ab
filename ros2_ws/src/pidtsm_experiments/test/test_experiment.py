"""What the user writes becomes the parameters of the nodes."""

from pathlib import Path

import pytest

from pidtsm_core.rollout import SCHEMAS
from pidtsm_experiments.experiment import make_experiment, scenario_names


@pytest.mark.parametrize(("text", "value"), [("1e-3", 0.001), ("-2E+1", -20.0), ("1.5e-3", 0.0015), ("5", 5)])
def test_numbers_may_have_exponents(tmp_path: Path, text: str, value: float) -> None:
    by_option = make_experiment("case1", overrides=[f"simulator.encoder.bias={text}"])
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(f"duration: 1.0\nsimulator: {{encoder.bias: [{text}, {text}]}}\n")
    assert by_option.settings["simulator"]["encoder.bias"] == value
    assert make_experiment(str(scenario)).settings["simulator"]["encoder.bias"] == [value, value]


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_is_accepted(name: str) -> None:
    assert make_experiment(name).resolved(SCHEMAS)
