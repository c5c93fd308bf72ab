"""``./pidtsm commission``: from a description to verified gains in one guided session."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL, Experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.parameters import resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.robots import DescriptionError, find_robot
from pidtsm_core.robots.compiler import load_spec
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.simulation.mujoco_model import SCENE
from pidtsm_experiments.commands.arm_options import read_arm
from pidtsm_experiments.commands.nodes_start import remaps
from pidtsm_experiments.commands.options import CONSOLE, add_experiment_arguments, experiment_of
from pidtsm_experiments.commissioning.consent import HEADINGS, QUESTION, heading, rows
from pidtsm_experiments.errors import RunError
from pidtsm_studies.commissioning.arm import CommissionError, Wiring
from pidtsm_studies.commissioning.bench import Plan
from pidtsm_studies.commissioning.motions import STEP, Motion
from pidtsm_studies.commissioning.session import NAMES, RefusedError, Session, Source, Subject
from pidtsm_studies.commissioning.simulated import SimulatedArm

_EPILOG = """Before each step you see what will move, how far and with how much torque, and agree. Ctrl-C brings the arm
to rest and ends the session; the arm stays held by a process of its own, even if this one is killed. The same command
goes on with the step that was not finished. docs/commissioning.md walks through it, and tells what stays a person's
job.

examples:
  ./pidtsm commission --robot my_arm.urdf --effort 20 --remap joint_commands:=/arm/effort --out results/my_arm
  ./pidtsm commission --robot my_arm.urdf --effort 20 --out results/my_arm --release
  ./pidtsm commission --robot panda --plant --hardware collaborative --yes
  ./pidtsm commission --robot panda --plant --invert panda_joint4 --out results/practice
  ./pidtsm commission --robot panda --plant --hardware collaborative --from friction --yes
"""
_DEFAULT = Path("results/commission")
_PURPOSE = MEASUREMENT._replace(usual=PRACTICAL)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser, duration=False)
    parser.epilog = _EPILOG
    parser.add_argument("--namespace", default="", metavar="NAME", help="namespace of the topics of the arm")
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name of a topic; can be repeated"
    )
    parser.add_argument(
        "--release", action="store_true", help="end what holds the arm after a session: something else must carry it"
    )
    parser.add_argument(
        "--plant", action="store_true", help="commission a simulated arm, as fast as it can be computed"
    )
    parser.add_argument(
        "--invert",
        action="append",
        default=[],
        metavar="JOINT[:position]",
        help="for practice: the torque (or position) of this joint of the simulated arm is inverted; can be repeated",
    )
    parser.add_argument(
        "--motion",
        type=Path,
        metavar="FILE.csv",
        help="what the arm is for, as reference.file has it, from rest to rest (default: all joints swing a little)",
    )
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="FILE.xml",
        help="MJCF file of what is around the arm, which motions keep clear of (default: simulator.scene; they keep "
        "clear of the arm itself in any case)",
    )
    parser.add_argument("--from", dest="first", choices=NAMES, help="repeat this step and all later ones, and compare")
    parser.add_argument("--yes", action="store_true", help="do not ask before each step (simulated arms only)")
    parser.add_argument("--no-bags", action="store_true", help="leave out the bags, which take longest to write")
    parser.add_argument(
        "--out",
        type=Path,
        default=_DEFAULT,
        metavar="DIR",
        help="folder of the session: commission.yaml, commissioned.urdf, report.html, bags (default: %(default)s)",
    )


def execute(options: argparse.Namespace) -> int:
    from pidtsm_experiments.commissioning.kept import write_results
    from pidtsm_studies.commissioning.result import PARAMETERS

    if options.yes and not options.plant:
        raise UsageError("--yes is for simulated arms: a person must agree before a real arm moves")
    if options.invert and not options.plant:
        raise UsageError("--invert is for simulated arms")
    experiment = experiment_of(options, _PURPOSE)
    definition = read_arm(options) or ArmDefinition(str(find_robot(experiment.settings["controller"]).name))
    if options.release:
        return _release(options)
    subject = _subject(options, experiment, definition)
    session = Session.opened(options.out, subject)
    if options.first is not None:
        session.repeat_from(options.first)
    if not session.missing:
        raise UsageError(f"{options.out}: every step is done; repeat some with --from, or name another --out")
    try:
        if options.plant:
            _run(session, _simulated(options, experiment, definition), options)
        else:
            _run_on_arm(session, options, definition)
    finally:
        written = write_results(session, definition.label)
    CONSOLE.print(f"{options.out}: {' '.join([*written, 'report.html', 'session.json'])}", highlight=False)
    described = next((name for name in written if name != PARAMETERS), definition.label)
    arm = options.out / described if described in written else described
    command = f"./pidtsm nodes start --robot {arm} --params {options.out / PARAMETERS}"
    CONSOLE.print(f"{command} uses the result", highlight=False, soft_wrap=True)
    return 0


def _run(session: Session, source: Source, options: argparse.Namespace) -> None:
    """Do the missing steps.

    Raises:
        RunError: a step cannot be completed, or the person does not agree to it.
    """
    from pidtsm_experiments.commissioning.kept import bag_keeper, no_bags

    keep = no_bags if options.no_bags else bag_keeper(session)
    try:
        session.run(source, _Consent(options.yes, session.subject.arm), _tell, keep)
    except RefusedError:
        raise RunError("not agreed; the same command asks again") from None
    except CommissionError as error:
        raise RunError(f"{error}\nthe same command begins with this step again") from None


def _run_on_arm(session: Session, options: argparse.Namespace, definition: ArmDefinition) -> None:
    """Do the missing steps on the arm of the user's ROS domain, and release it if all are done."""
    from pidtsm_experiments.commissioning.remote import RemoteArm

    words = [word for remap in remaps(options.remap) for word in ("-r", remap)]
    try:
        arm = RemoteArm(options.out, definition.settings(), options.namespace, words)
    except CommissionError as error:
        raise RunError(str(error)) from None
    with arm:
        if arm.was_held:
            _tell("the arm is held since the last session")
        _run(session, arm, options)
        input("All steps are done. Let brakes or a support carry the arm, then press Enter: commands cease. ")
        arm.release()


def _release(options: argparse.Namespace) -> int:
    from pidtsm_experiments.commissioning.remote import release

    if not release(options.out):
        raise RunError(f"{options.out}: nothing holds an arm")
    CONSOLE.print("released: commands have ceased", highlight=False)
    return 0


def _subject(options: argparse.Namespace, experiment: Experiment, definition: ArmDefinition) -> Subject:
    arm = definition.settings()
    before = {**experiment.settings["controller"], **arm}
    motion = None if options.motion is None else _motion(options.motion, find_robot(arm).joints)
    scene = str(experiment.settings["simulator"].get(SCENE.name, "")) if options.scene is None else str(options.scene)
    if scene:  # Before anything moves.
        try:
            load_spec(Path(scene))
        except DescriptionError as error:
            raise UsageError(f"--scene {scene}: {error}") from None
    return Subject(arm, before, motion, definition.described, scene and str(Path(scene).absolute()))


def _motion(file: Path, joints: tuple[str, ...]) -> Motion:
    """The motion of a file, in the order of joints.

    Raises:
        UsageError: it cannot be read, or does not begin and end at rest.
    """
    settings = {"joints": list(joints), "reference.name": "csv", "reference.file": str(file.absolute())}
    reference = ReferenceMotion(resolve(reference_schema, settings, len(joints)))
    with file.open(encoding="utf-8") as lines:
        duration = float(lines.readlines()[-1].split(",")[0])
    times, state = np.arange(0.0, duration + STEP, STEP), np.empty((3, len(joints)))
    states = np.empty((3, times.size, len(joints)))
    for k, time in enumerate(times):
        reference.evaluate(float(time), state)
        states[:, k] = state
    if np.abs(states[1, [0, -1]]).max() > 1e-3:
        raise UsageError(f"--motion {file}: it must begin and end at rest")
    states[1:, [0, -1]] = 0.0
    return Motion(states)


def _simulated(options: argparse.Namespace, experiment: Experiment, definition: ArmDefinition) -> SimulatedArm:
    """The simulated arm, with what the options say of its wiring."""
    joints = find_robot(definition.settings()).joints
    wiring = Wiring.described(len(joints))
    for each in options.invert:
        joint, _, what = each.partition(":")
        if joint not in joints or what not in ("", "position", "effort"):
            raise UsageError(f"--invert {each}: must be JOINT or JOINT:position with one of {', '.join(joints)}")
        (wiring.position if what == "position" else wiring.effort)[joints.index(joint)] = -1.0
    return SimulatedArm(experiment.settings["simulator"], wiring)


class _Consent:
    """Asks a person before each step."""

    def __init__(self, given: bool, arm: Mapping[str, Any]) -> None:
        self._given, self._arm = given, arm

    def __call__(self, step: str, plan: Plan) -> bool:
        """Show the plan of a step, and ask."""
        CONSOLE.print(f"\n[bold]{heading(step)}[/bold], {plan.duration:.0f} s")
        CONSOLE.print(plan.text, highlight=False, soft_wrap=True)
        if self._given:
            return True
        table = Table(box=box.SIMPLE_HEAD)
        for text in HEADINGS:
            table.add_column(text, justify="left" if text == HEADINGS[0] else "right")
        for joint, travel, effort in rows(plan, self._arm):
            table.add_row(escape(joint), travel, effort)
        CONSOLE.print(table)
        if not sys.stdin.isatty():
            raise UsageError("somebody must agree to each step at a terminal (--yes is for simulated arms)")
        return input(f"{QUESTION} Begin? [y/N] ").strip().lower() == "y"


def _tell(text: str) -> None:
    CONSOLE.print(f"  {text}", highlight=False, soft_wrap=True, markup=False)
