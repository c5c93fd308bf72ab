"""One way to define the arm, on every command that takes ``--robot``."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.definition import find_arm
from pidtsm_core.robots.stored import stored_file, stored_names
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.cli import _COMMANDS, _parser, main
from pidtsm_experiments.commands.arm_options import read_arm

LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="{1}"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="{4}" effort="{5}" velocity="2"/></joint>'
)
ARM = "".join(
    (
        '<robot name="crane" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="mass" default="2"/>',
        '<link name="floor"/>',
        *(
            LINK.format(name, mass)
            for name, mass in (("mast", "$(arg mass)"), ("boom", 2), ("hook", 1), ("finger", 0.1))
        ),
        JOINT.format("shoulder", "revolute", "floor", "mast", 1, 90),
        JOINT.format("elbow", "revolute", "mast", "boom", 1, 60),
        JOINT.format("wrist", "revolute", "boom", "hook", 1, 30),
        JOINT.format("pinch", "prismatic", "hook", "finger", -0.97, 5),
        "</robot>",
    )
)
FILE = "crane.urdf.xacro"
OPTIONS = ("--joints", "--lock", "--effort", "--payload", "--xacro", "--save")
NEEDED = {
    "diagnose": ["bag"],
    "excite": ["--out", "motion.yaml"],
    "export": ["bag", "--foxglove"],
    "identify": ["bag"],
    "identify-payload": ["bag"],
    "move": ["--to", "0"],
    "replay-motion": ["bag"],
}
"""Words that a command cannot do without."""
Call = Callable[..., tuple[int, str, str]]


def options_of(command: str) -> set[str]:
    """Of a command, or of an action of one, such as ``nodes start``."""
    parser: argparse.ArgumentParser = _parser(command.split(maxsplit=1)[0])
    for word in command.split():
        parser = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction)).choices[word]
    return {text for action in parser._actions for text in action.option_strings}


WITH_ARM = [command for command in (*_COMMANDS, "nodes start") if "--robot" in options_of(command)]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """A command in a folder with the arm and a configuration of its own: exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "configuration"))
    Path(FILE).write_text(ARM, encoding="utf-8")

    def call(*words: str) -> tuple[int, str, str]:
        return main(words), *capsys.readouterr()

    return call


def gains(call: Call, *words: str) -> dict[str, dict[str, object]]:
    code, out, err = call("gains", *words, "--json")
    assert code == 0, err
    found: dict[str, dict[str, object]] = json.loads(out)
    return found


def test_the_commands_with_an_arm_are_known() -> None:
    """So that the tests below miss none."""
    expected = "demo run live rollout compare-engines gains excite identify identify-payload tune tournament score move"
    assert {"nodes start", "replay-motion"} <= set(WITH_ARM)
    assert set(expected.split()) <= set(WITH_ARM)


@pytest.mark.parametrize("command", WITH_ARM)
def test_every_command_with_an_arm_has_all_options(command: str) -> None:
    assert set(OPTIONS) <= options_of(command)


@pytest.mark.parametrize("command", WITH_ARM)
def test_every_command_uses_them(command: str, call: Call) -> None:
    """A joint that does not exist is refused, before anything is written; the message names it and those that exist."""
    code, out, err = call(
        *command.split(), *NEEDED.get(command, []), "--robot", FILE, "--joints", "knee", "--save", "mine"
    )
    assert (code, out) == (2, "")
    assert "there is no movable joint knee; there are shoulder, elbow, wrist, pinch" in err
    assert err.count("\n") == 1
    assert not stored_names()


def test_from_nothing_to_a_tracked_arm_with_two_commands(call: Call) -> None:
    """The first one may be refused, and names the second one."""
    two = (
        ARM.replace("</robot>", "") + LINK.format("post", 9) + JOINT.format("turn", "revolute", "floor", "post", 1, 90)
    )
    Path(FILE).write_text(two + "</robot>", encoding="utf-8")
    code, _, err = call("rollout", "--robot", FILE, "--params", "practical")
    assert code == 2
    assert "--joints shoulder,elbow,wrist or --joints turn" in err
    words = ["--joints", "shoulder,elbow,wrist", "--params", "practical", "--json"]
    code, out, err = call("rollout", "--robot", FILE, *words)
    assert code == 0, err
    assert max(json.loads(out)["rmse"]) < 1e-3


def test_it_prints_which_joints_of_a_file_move(call: Call) -> None:
    line = "pidtsm: crane.urdf.xacro: moves shoulder, elbow, wrist; locks pinch (a gripper: by its name"
    code, _, err = call("gains", "--robot", FILE)
    assert code == 0
    assert err.startswith(line)
    assert err.count("\n") == 1
    assert call("gains", "--robot", "scara")[2] == ""


def test_a_joint_that_can_hardly_carry_the_arm_is_named_with_the_cure(call: Call) -> None:
    code, _, err = call("gains", "--robot", FILE, "--effort", "shoulder=20", "--payload", "2")
    assert code == 0
    warning = err.splitlines()[1]
    assert "takes shoulder 29.4 of 20 N m; " in warning
    cure = warning.rpartition("--effort ")[2]
    assert call("gains", "--robot", FILE, "--effort", cure, "--payload", "2")[2].count("\n") == 1


def test_a_stored_arm_is_known_to_commands_and_to_python(call: Call) -> None:
    words = ["--joints", "elbow,wrist", "--lock", "shoulder=0.3", "--effort", "wrist=20", "--payload", "0.5@0,0,0.1"]
    words += ["--xacro", "mass:=3"]
    given = gains(call, "--robot", FILE, *words)
    code, _, err = call("gains", "--robot", FILE, *words, "--save", "crane")
    assert code == 0
    assert f"crane: stored in {stored_file('crane')}; --robot crane uses it" in err
    assert gains(call, "--robot", "crane") == given
    assert call("gains", "--robot", "crane")[2] == ""
    run = rollout(robot="crane", duration=0.01)
    assert run.joints == ("elbow", "wrist")
    assert run.robot["robot.locked"] == "shoulder=0.3"
    arm = find_arm("crane")
    assert (arm.effort, arm.payload, arm.xacro) == ({"wrist": 20.0}, 0.5, {"mass": "3"})
    code, _, err = call("gains", "--robot", "cran")
    assert code == 2
    assert "one of two_link, panda, scara, ur5, xarm7, z1, crane; did you mean crane?" in err


def test_check_judges_the_arm_that_the_options_define(call: Call) -> None:
    words = ["--joints", "elbow,wrist", "--effort", "elbow=1", "--xacro", "mass:=3", "--save", "crane"]
    code, out, err = call("check", FILE, *words)
    assert code == 1, err
    assert "elbow" in out
    assert find_arm("crane").joints == ("elbow", "wrist")
    assert call("check", "crane")[:2] == (code, out.replace(FILE, str(Path(FILE).absolute())))
    code, out, err = call("check", FILE, "--json")
    assert "gripper: by its name" in out, err


def test_options_vary_a_stored_arm(call: Call) -> None:
    assert call("gains", "--robot", FILE, "--payload", "1", "--save", "crane")[0] == 0
    assert find_arm("crane").joints == ("shoulder", "elbow", "wrist")
    code, _, err = call("gains", "--robot", "crane", "--lock", "elbow=0.2", "--save", "stiff")
    assert code == 0, err
    stiff = find_arm("stiff")
    assert (stiff.joints, stiff.locked, stiff.payload) == (("shoulder", "wrist"), {"elbow": 0.2}, 1.0)
    code, _, err = call("gains", "--robot", "crane", "--save", "stiff")
    assert code == 0
    assert "stiff: replaced in" in err
    assert find_arm("stiff").joints == ("shoulder", "elbow", "wrist")


@pytest.mark.parametrize("option", [["--payload", "3"], ["--effort", "5"], ["--joints", "shoulder,elbow"]])
def test_gains_depend_on_what_is_specified_about_the_arm(option: list[str], call: Call) -> None:
    """With coarse encoders: the less inertia a step moves, the higher the bandwidth."""
    coarse = ["--robot", FILE, "--encoder-bits", "10"]
    without, given = (gains(call, *coarse, *words)["estimator.bandwidth"]["value"] for words in ([], option))
    assert without != given


def test_a_motion_of_excitation_is_one_of_this_arm(call: Call) -> None:
    words = ["--joints", "elbow,wrist", "--lock", "shoulder=0.3", "--payload", "0.5", "--xacro", "mass:=3"]
    code, _, err = call("excite", "--robot", FILE, *words, "--duration", "2", "--out", "motion.yaml")
    assert code == 0, err
    for values in make_experiment("motion.yaml").values.values():
        assert values["joints"] == ("elbow", "wrist")
        assert values.get("robot.locked", "shoulder=0.3") == "shoulder=0.3"
        assert values.get("payload.mass", 0.5) == 0.5
        assert values.get("robot.xacro", "mass:=3") == "mass:=3"


def test_the_options_of_an_arm_are_equivalent(call: Call) -> None:
    parser = _parser("rollout")
    words = [
        "--joints",
        "elbow,wrist",
        "--lock",
        "shoulder=0.3",
        "--effort",
        "20,30",
        "--payload",
        "0.5@0,0,0.1",
        "--xacro",
        "mass:=3",
    ]
    arm = read_arm(parser.parse_args(["rollout", "--robot", FILE, *words]))
    assert arm is not None
    assert read_arm(parser.parse_args(["rollout", *arm.words()])) == arm


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["--joints", "a,b"], "--joints needs --robot"),
        (["--save", "mine"], "--save needs --robot"),
        (["--robot", FILE, "--joints", ","], "names no joint"),
        (["--robot", FILE, "--lock", "elbow"], "is not of the form JOINT=POSITION"),
        (["--robot", FILE, "--lock", "elbow=much"], "'much' is not a finite number"),
        (["--robot", FILE, "--lock", "knee=0"], "no movable joint knee"),
        (["--robot", FILE, "--joints", "elbow", "--lock", "elbow=0"], "both name elbow"),
        (["--robot", FILE, "--effort", "80,-1"], "'-1' must be above zero"),
        (["--robot", FILE, "--effort", "80,wrist=1"], "is neither of the form"),
        (["--robot", FILE, "--effort", "1,2"], "2 limits for 3 joints, shoulder, elbow, wrist"),
        (["--robot", FILE, "--payload", "1.5@0,0"], "is not of the form KG or KG@X,Y,Z"),
        (["--robot", FILE, "--payload", "-1"], "is not of the form KG or KG@X,Y,Z"),
        (["--robot", FILE, "--xacro", "mass=5"], "is not of the form NAME:=VALUE"),
        (["--robot", FILE, "--xacro", "mas:=5"], "no argument mas; it has mass"),
        (["--robot", FILE, "--save", "panda"], "comes with pidtsm"),
        (["--robot", FILE, "--save", "../a"], "is no name for an arm"),
    ],
)
def test_bad_input_is_one_line_and_stores_nothing(words: list[str], cause: str, call: Call) -> None:
    code, out, err = call("gains", *words)
    assert (code, out) == (2, "")
    assert cause in err
    assert err.count("\n") == 1
    assert not stored_names()


def test_a_bad_option_elsewhere_stores_nothing(call: Call) -> None:
    for words in (["--law", "none"], ["--set", "controller.law.k9=1"]):
        assert call("rollout", "--robot", FILE, "--save", "mine", *words)[0] == 2
    assert not stored_names()


def test_an_arm_that_cannot_be_stored_is_one_line(call: Call) -> None:
    Path("configuration").write_text("a file where the folder should be", encoding="utf-8")
    code, _, err = call("gains", "--robot", FILE, "--save", "mine")
    assert code == 2
    assert "--save mine: " in err


def test_options_of_one_arm_do_not_fit_several(call: Call) -> None:
    code, _, err = call("tournament", "--robot", "scara", "--robot", "panda", "--payload", "1")
    assert code == 2
    assert "--payload is for one arm, and --robot names 2; store each one with --save first" in err
