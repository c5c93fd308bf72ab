"""Every page of a run shows what made it."""

from dataclasses import replace

from pidtsm_core import __version__
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.reports.sections import command_text, made_section


def test_version_commit_command_seed_and_gains_are_rows() -> None:
    run = rollout(duration=0.01, law="pid", simulator={"seed": 3}, controller={"law.kp": [50.0, 1e-5]})
    other = replace(run, version=None, recorded_commit="", parameters={})
    content = made_section(
        {"mine": run, "other": other}, {"mine": ["/somewhere/cli.py", "rollout", "--law", "p d"]}
    ).content
    assert content["runs"] == ["mine", "other"]
    rows = {name: values[0] for name, values in content["rows"].items()}
    assert (rows["pidtsm"], rows["seed"], rows["law.name"]) == (__version__, "3", "pid")
    assert rows["command"] == "./pidtsm rollout --law 'p d'"
    assert rows["law.kp"] == "50.0, 1e-05"
    assert {values[1] for values in content["rows"].values()} == {"–"}
    assert made_section({"other": other}, {}).content is None


def test_a_command_of_another_program_keeps_its_name() -> None:
    assert command_text(["/tmp/study.py", "-q"]) == "study.py -q"
    assert command_text([]) == ""
