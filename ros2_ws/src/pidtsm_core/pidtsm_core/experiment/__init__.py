"""Definition of a run: a scenario, a law, and the resulting parameters of every node."""

import functools
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from pidtsm_core.control import LAW_NAME
from pidtsm_core.control.parameters import SOFTENING
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.default_motion import DURATION, default_motion
from pidtsm_core.experiment.definition import MEASUREMENT, Experiment, Purpose
from pidtsm_core.experiment.gains import first_gains
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.experiment.law_gains import RULED
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import ParameterError, as_float, did_you_mean
from pidtsm_core.parameters.files import NODES, Settings, flatten, load_mapping, load_ros_parameters, read_yaml
from pidtsm_core.robots import DESCRIPTION, NAMES, OF_ARM, TreeRobot, find_robot
from pidtsm_core.robots.definition import ArmDefinition, GripperLockedWarning, find_arm, joints_sentence
from pidtsm_core.simulation.plant_parameters import RATE
from pidtsm_core.timing import LONGEST_RUN

__all__ = ["Experiment", "make_experiment", "scenario_names"]

ARTICLE = "article"
"""Name of the parameter set of the article's Table 1."""
DEFAULT_ROBOT = str(DESCRIPTION.default)
DEFAULT_SCENARIO = "case1"
"""Scenario if neither a scenario nor a robot is chosen."""
PRACTICAL = "practical"
"""Name of the parameter set for real sensors and drives."""
ADAPTIVE = "adaptive"
"""Name of the set that is `PRACTICAL` and finds out about the arm while it moves."""
ADAPTS_ON_HARDWARE = {"adaptation.friction": "learn", "adaptation.softening": "act"}
ADAPTS = {**ADAPTS_ON_HARDWARE, "adaptation.lateness": "learn"}
"""What `ADAPTIVE` switches on; with a class of hardware only the former, see docs/adaptation.md."""
TUNED = "tuned_"
"""Prefix of the names of tuned parameter sets; a class of hardware follows."""
TUNED_FOR_CLASS = "tuned"
"""Name of the set that was tuned for the class of hardware that the arm has."""
_SCENARIOS, _PARAMETERS = (Path(__file__).with_name(folder) for folder in ("scenarios", "params"))
PRACTICAL_FILE = _PARAMETERS / f"{PRACTICAL}.yaml"
_CHOICES = {"estimator.name", "law.surface", "law.manifold", "law.reaching"}
"""Parameters on which others depend: with another choice than its own, `PRACTICAL` has some that are not known."""
_SCENARIO_KEYS = ("description", "duration", *NODES)


def scenario_names() -> list[str]:
    """Names of the scenarios included in the package."""
    return sorted(file.stem for file in _SCENARIOS.glob("*.yaml"))


def make_experiment(
    scenario: str | Experiment | None,
    law: str | None = None,
    duration: float | None = None,
    params: str | Sequence[str] = (),
    overrides: Sequence[str] | Mapping[str, Mapping[str, Any]] = (),
    robot: str | ArmDefinition | None = None,
    hardware: str | None = None,
    purpose: Purpose = MEASUREMENT,
) -> Experiment:
    """Combine the parts of an experiment, and check its parameters.

    Later ones override earlier ones: scenario, robot, hardware, parameter files, law, overrides.

    Args:
        scenario: a name from `scenario_names`, the path of a scenario file, or an experiment to vary; None: Case 1, or
            for another robot, also one among the overrides, its `default_motion`.
        law: a name in `LAWS`; None: the law of the scenario or parameter files, or else the default law.
        duration: s; replaces the scenario's if given.
        params: path of a ROS parameter file, or several; none: ``practical`` for an arm from a file, or with a class of
            hardware, unless the scenario has gains. ``article`` is the article's Table 1 for the law (`law` if given,
            else the one set by the earlier parts), ``practical`` the set for real sensors and drives
            (`practical_settings`), ``adaptive`` the same with ``adaptation.*`` switched on, for a law with a model,
            ``tuned_14bit`` (17bit, 12bit, ideal) one that ``./pidtsm tune`` made for the arm, ``tuned`` one of any law
            for the arm's own hardware.
        overrides: texts ``NODE.PARAMETER=VALUE``, or values by node and name; groups may be nested.
        robot: the arm of simulator and controller: a name, also one under which the user has stored an arm, the path of
            a description, or an `ArmDefinition`; None: that of the scenario.
        hardware: a class of hardware from `hardware_names`; None: that of the scenario.
        purpose: what it is made for.

    Raises:
        UsageError: anything unknown, malformed or refused; the message contains the file, the key and what is allowed.
    """
    if law is not None and law not in LAWS.names:
        raise UsageError(f"unknown law {law}; known: {', '.join(LAWS.names)}")
    chosen = list(_overrides(overrides))
    varies = law or params or chosen or robot or hardware
    if (
        isinstance(scenario, Experiment)
        and not varies
        and duration in (None, scenario.duration)
        and purpose == scenario.purpose
    ):
        return scenario
    arm = None if robot is None else find_arm(robot)
    named = [params] if isinstance(params, str) else params
    experiment = _combined(scenario, law, duration, named, chosen, arm, hardware, purpose)
    _ = experiment.values
    return experiment


def _combined(
    scenario: str | Experiment | None,
    law: str | None,
    duration: float | None,
    params: Sequence[str],
    chosen: Sequence[tuple[str, str, Any]],
    arm: ArmDefinition | None,
    hardware: str | None,
    purpose: Purpose,
) -> Experiment:
    """The experiment, not checked yet; see `make_experiment`. `chosen`: node, name and value of each override."""
    of_arm = {} if arm is None else arm.settings()
    base = scenario if isinstance(scenario, Experiment) else _scenario(scenario, _arm(of_arm, chosen), duration)
    settings: Settings = {node: dict(given) for node, given in base.settings.items()}
    files = dict(base.files)

    def merge(more: Settings, source: Path) -> None:
        for node, parameters in more.items():
            settings[node].update(parameters)
            files.update({f"{node}.{name}": str(source) for name in parameters})

    if arm is not None:
        _warn_of_gripper(arm, of_arm)
        merge(dict.fromkeys(("simulator", "controller"), of_arm), Path(arm.label))
    if hardware is not None:
        of_hardware = hardware_settings(hardware, _overridden(settings, chosen)["simulator"])
        merge({"simulator": of_hardware}, Path(hardware))
    wanted = law or next((value for node, name, value in chosen if (node, name) == ("controller", LAW_NAME.name)), None)
    for name in params or _usual(_source(arm, scenario, base), wanted, base, chosen, purpose, hardware):
        before = wanted or settings["controller"].get(LAW_NAME.name)
        merge(*_parameter_set(name, before if before in LAWS.names else None, _overridden(settings, chosen), hardware))
    if law is not None:
        settings["controller"]["law.name"] = law
    for node, name, value in chosen:
        settings[node][name] = value
        files.pop(f"{node}.{name}", None)
    name_of_law = str(settings["controller"].get("law.name", LAW_NAME.default))
    seconds = base.duration if duration is None else _positive(duration, "duration")
    return Experiment(base.scenario, name_of_law, seconds, settings, files, purpose)


def _parameter_set(name: str, law: str | None, settings: Settings, hardware: str | None) -> tuple[Settings, Path]:
    """The parameters of a named set or of a file, and where they come from; see `make_experiment`.

    Args:
        name: of the set, or path of the file.
        law: name of the law; None: the default law.
        settings: of the experiment without this set.
        hardware: class of hardware; None: none.
    """
    if name in (PRACTICAL, ADAPTIVE):
        gains = practical_settings(law, settings, hardware, adapts=name == ADAPTIVE)["controller"]
        adapts = ADAPTS_ON_HARDWARE if hardware else ADAPTS
        of_law = LAWS[law or str(LAW_NAME.default)]
        adapts = adapts if name == ADAPTIVE else {}
        adapts = {each: how for each, how in adapts.items() if of_law.softens or each != SOFTENING.name}
        return {"controller": {**gains, **adapts}}, Path(name)
    if name == TUNED_FOR_CLASS or name.startswith(TUNED):
        source = tuned_parameters(name, law, settings)
    elif name == ARTICLE:
        source = article_parameters(law)
    else:
        source = _parameter_file(name)
    return load_ros_parameters(source), source


def _parameter_file(name: str) -> Path:
    """The file of this name.

    Raises:
        UsageError: there is none; the message contains the named sets.
    """
    sets = (ARTICLE, PRACTICAL, ADAPTIVE, TUNED_FOR_CLASS)
    with suppress(OSError):  # The name is too long, or its folder is not readable.
        if not Path(name).exists():
            known = f"{', '.join(sets)} and {TUNED}14bit"
            hint = did_you_mean(name, sets)
            raise UsageError(f"{name}: No such file or directory; neither a file nor one of {known}{hint}")
    return Path(name)


def _source(arm: ArmDefinition | None, scenario: str | Experiment | None, base: Experiment) -> str | None:
    """Description of the arm by the user or by a scenario; None: neither gives one."""
    of_scenario = _robot(base.settings) if isinstance(scenario, str) else None
    return of_scenario if arm is None else arm.description


def _usual(
    source: str | None,
    law: str | None,
    base: Experiment,
    overrides: Iterable[tuple[str, str, Any]],
    purpose: Purpose,
    hardware: str | None,
) -> list[str]:
    """Parameter sets if none is named: `PRACTICAL` for an arm from a file, or with a class of hardware.

    The article's gains are those of another arm, with ideal sensors and drives.

    Args:
        source: see `_source`.
        law: name of the law that is given beside the scenario; None: none is.
        base: the scenario.
        overrides: node, name and value of each.
        purpose: may have a set that is usual.
        hardware: class of hardware; None: none.
    """
    given = base.settings["controller"]
    choices = {name for node, name, _ in overrides if node == "controller"} & _CHOICES
    chosen = choices or any(name.startswith(("law.", "estimator.")) and name != "law.name" for name in given)
    name = law or given.get("law.name", LAW_NAME.default)
    if purpose.usual and name == LAW_NAME.default:
        return [purpose.usual]
    of_file = source is not None and source not in NAMES
    return [PRACTICAL] if (of_file or hardware) and not chosen and name in RULED else []


def _overrides(given: Sequence[str] | Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, str, Any]]:
    """Node, name and value of each override; see `make_experiment`."""
    if not isinstance(given, Mapping):
        yield from map(_parse_override, given)
        return
    for node, parameters in given.items():
        if node not in NODES:
            raise UsageError(f"unknown node {node}; known: {', '.join(NODES)}")
        for name, value in flatten(dict(parameters), node).items():
            yield node, name, value


def _warn_of_gripper(arm: ArmDefinition, of_arm: Mapping[str, Any]) -> None:
    """Warn if joints that nobody has named were recognised as a gripper."""
    if arm.joints or not arm.is_file:
        return
    # An override may choose the joints; if none does, the nodes' schemas refuse the arm.
    with suppress(ParameterError):
        robot = find_robot({name: value for name, value in of_arm.items() if name in OF_ARM})
        if isinstance(robot, TreeRobot) and robot.description.grippers:
            sentence = joints_sentence(robot.description, "ArmDefinition(joints=..., locked=...)")
            warnings.warn(f"{robot.name}: {sentence}", GripperLockedWarning, stacklevel=4)


def _arm(of_arm: Mapping[str, Any], overrides: Iterable[tuple[str, str, Any]]) -> dict[str, Any]:
    """Parameters that choose the arm, with those overrides that are the same for simulator and controller."""
    chosen: dict[str, dict[str, Any]] = {"simulator": {}, "controller": {}}
    for node, name, value in overrides:
        if node in chosen and name in OF_ARM:
            chosen[node][name] = value
    same = {name: value for name, value in chosen["controller"].items() if chosen["simulator"].get(name) == value}
    return {name: value for name, value in of_arm.items() if name in OF_ARM} | same


def _overridden(settings: Settings, overrides: Iterable[tuple[str, str, Any]]) -> Settings:
    """A copy of settings in which overrides (node, name, value) are made."""
    changed = {node: dict(given) for node, given in settings.items()}
    for node, name, value in overrides:
        changed[node][name] = value
    return changed


def article_parameters(law: str | None) -> Path:
    """ROS parameter file with the article's Table 1 for a law (None: the default law).

    Raises:
        UsageError: the article has no parameters for this law.
    """
    file = _PARAMETERS / f"{law or LAW_NAME.default}.yaml"
    if not file.is_file():
        raise UsageError(f"the article has no parameters for {law}; omit --params {ARTICLE}, or specify a file")
    return file


def tuned_parameters(name: str, law: str | None, settings: Mapping[str, Mapping[str, Any]]) -> Path:
    """ROS parameter file of a tuned set.

    Args:
        name: of the set, such as ``tuned_14bit``; ``tuned``: that for the arm's own class of hardware.
        law: name of the law; None: the default law.
        settings: of the experiment without this set; the arm matters.

    Raises:
        UsageError: there is none for this arm, hardware and law.
    """
    robot, wanted, hardware = _robot(settings), law or str(LAW_NAME.default), name.removeprefix(TUNED)
    folder = _PARAMETERS / "tuned"
    known = {file.stem: file for file in folder.glob("*.yaml") if wanted == LAW_NAME.default}
    of_law = {file.stem: file for file in sorted((folder / "laws").glob(f"*-{wanted}.yaml"))}
    if f"{robot}-{hardware}" in known:
        return known[f"{robot}-{hardware}"]
    begin = f"{robot}-" if name == TUNED_FOR_CLASS else f"{robot}-{hardware}-"
    for stem, file in of_law.items():
        if stem.startswith(begin):
            return file
    raise UsageError(
        f"no set {name} for {wanted} on {robot}; make one with ./pidtsm tune, or choose another arm or hardware; for "
        f"{wanted} there are {', '.join(sorted([*known, *of_law])) or 'none'}"
    )


def practical_settings(
    law: str | None, settings: Mapping[str, Mapping[str, Any]], hardware: str | None = None, adapts: bool = False
) -> Settings:
    """Parameters for real sensors and drives: the `first_gains` of the law.

    Of the proposed law on an arm in closed form, they are those of ``practical.yaml``. With a class of hardware, they
    are the `hardware_gains` for the sensors, drives and gears in `settings`.

    Args:
        law: name of the law; None: the default law.
        settings: of the experiment without this set; the arm and the rate matter, and with a class the simulator.
        hardware: the class; None: none.
        adapts: on hardware, the gains also suit a controller that learns friction.

    Raises:
        UsageError: there is no rule for the law, or the arm cannot be used.
    """
    controller = settings["controller"]
    name = law or str(LAW_NAME.default)
    if hardware is not None:
        gains = hardware_gains(controller, settings["simulator"], name, learns_friction=adapts)
        return {"controller": {gain.name: gain.value for gain in gains}}
    if _robot(settings) == DEFAULT_ROBOT and name == LAW_NAME.default:
        return load_ros_parameters(PRACTICAL_FILE)
    rate = as_float(RATE.check(settings["simulator"].get("rate", RATE.default), 1))
    return {"controller": {gain.name: gain.value for gain in first_gains(controller, rate=rate, law=name)}}


def _robot(settings: Mapping[str, Mapping[str, Any]]) -> str:
    """The arm of the controller."""
    return str(settings["controller"].get(DESCRIPTION.name, DEFAULT_ROBOT))


def _scenario_file(scenario: str) -> Path:
    if scenario in scenario_names():
        return _SCENARIOS / f"{scenario}.yaml"
    with suppress(OSError):  # The name is too long, or its folder is not readable.
        if Path(scenario).is_file():
            return Path(scenario)
    raise UsageError(f"no scenario {scenario}: neither a file nor one of {', '.join(scenario_names())}")


def _scenario(scenario: str | None, arm: Mapping[str, Any], duration: float | None) -> Experiment:
    """The experiment that a scenario defines, or the default one of an arm; see `make_experiment`."""
    robot = arm.get(DESCRIPTION.name, DEFAULT_ROBOT)
    if scenario is not None or robot == DEFAULT_ROBOT:
        file = _scenario_file(scenario or DEFAULT_SCENARIO)
        content = _load_scenario(file) if file.parent != _SCENARIOS else _packaged(file)
    else:
        found = find_robot(arm)
        file, content = Path(found.name), {"duration": DURATION, **default_motion(found)}
    seconds = _positive(content.get("duration"), f"{file}: duration") if duration is None else duration
    settings = {node: flatten(content.get(node) or {}, f"{file}: {node}") for node in NODES}
    files = {f"{node}.{name}": str(file) for node, given in settings.items() for name in given}
    return Experiment(file.stem, "", seconds, settings, files)


def _load_scenario(file: Path) -> dict[str, Any]:
    content = load_mapping(file)
    for key in content:
        if key not in _SCENARIO_KEYS:
            raise UsageError(f"{file}: unknown key {key}; allowed: {', '.join(_SCENARIO_KEYS)}")
    return content


_packaged = functools.cache(_load_scenario)
"""Scenarios of the package do not change, and a batch needs one for each run."""


def _parse_override(text: str) -> tuple[str, str, Any]:
    path, equals, value = text.partition("=")
    node, dot, name = path.partition(".")
    if not equals or not dot or not name or node not in NODES:
        raise UsageError(f"--set {text}: must be NODE.PARAMETER=VALUE with NODE one of {', '.join(NODES)}")
    try:
        return node, name, read_yaml(value)
    except yaml.YAMLError:
        raise UsageError(f"--set {text}: {value!r} is not a valid value") from None


def _positive(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value <= LONGEST_RUN:
        raise ParameterError(f"{where}: {value!r} must be a positive number of seconds, at most {LONGEST_RUN:g}")
    return float(value)
