"""Robust joint-space torque control of robot arms without ROS: simulate, compare and call controllers.

    import pidtsm_core as pidtsm

    run = pidtsm.rollout("case1", law="piddtsm", params="practical", controller={"law.k1": 3.0})
    print(run, run.metrics()["rmse"])
    run.plot().savefig("run.png")

Values per joint are in the order of `Recording.joints`. Units are SI units and rad; of a joint that slides, rad is m
and N m is N.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pidtsm_core.control.controller import Controller
    from pidtsm_core.errors import MemberError, UsageError
    from pidtsm_core.estimators.base import Estimator
    from pidtsm_core.experiment import make_experiment, scenario_names
    from pidtsm_core.experiment.definition import Experiment
    from pidtsm_core.laws.base import ArmSample, Demand, Law
    from pidtsm_core.laws.of_arm import arm_law
    from pidtsm_core.laws.own import own_law
    from pidtsm_core.laws.reaching.base import ReachingLaw
    from pidtsm_core.laws.sliding_mode import compose
    from pidtsm_core.laws.surfaces.base import Surface
    from pidtsm_core.parameters import Parameter, ParameterError
    from pidtsm_core.recording import Recording
    from pidtsm_core.references.base import Reference
    from pidtsm_core.references.sampled import sampled_reference
    from pidtsm_core.registration import register
    from pidtsm_core.robots import inverse_dynamics
    from pidtsm_core.robots.base import Robot
    from pidtsm_core.robots.definition import ArmDefinition
    from pidtsm_core.rollouts.batches import BatchResult, Trajectory, batch
    from pidtsm_core.rollouts.closed_loop import DivergedError, make_controller, rollout
    from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status
    from pidtsm_core.simulation.disturbances.base import Disturbance
    from pidtsm_core.simulation.disturbances.sampled import sampled_disturbance

__version__ = "0.2.0"
"""Defined here alone; a test compares the versions of the packages with it."""

_MODULES = {
    "ArmDefinition": "robots.definition",
    "BatchResult": "rollouts.batches",
    "ArmSample": "laws.base",
    "Controller": "control.controller",
    "Demand": "laws.base",
    "Disturbance": "simulation.disturbances.base",
    "DivergedError": "rollouts.closed_loop",
    "Estimator": "estimators.base",
    "Experiment": "experiment.definition",
    "Fault": "signals",
    "Law": "laws.base",
    "Limited": "signals",
    "MemberError": "errors",
    "Mode": "signals",
    "Parameter": "parameters",
    "ParameterError": "parameters",
    "ReachingLaw": "laws.reaching.base",
    "Recording": "recording",
    "Reference": "references.base",
    "Robot": "robots.base",
    "Signal": "signals",
    "Status": "signals",
    "Surface": "laws.surfaces.base",
    "Trajectory": "rollouts.batches",
    "UsageError": "errors",
    "arm_law": "laws.of_arm",
    "batch": "rollouts.batches",
    "compose": "laws.sliding_mode",
    "inverse_dynamics": "robots",
    "make_controller": "rollouts.closed_loop",
    "make_experiment": "experiment",
    "own_law": "laws.own",
    "register": "registration",
    "rollout": "rollouts.closed_loop",
    "sampled_disturbance": "simulation.disturbances.sampled",
    "sampled_reference": "references.sampled",
    "scenario_names": "experiment",
}
"""Module of each public name: imported when it is first used, because importing the compiler takes half a second."""

__all__ = [
    "ArmDefinition",
    "ArmSample",
    "BatchResult",
    "Controller",
    "Demand",
    "Disturbance",
    "DivergedError",
    "Estimator",
    "Experiment",
    "Fault",
    "Law",
    "Limited",
    "MemberError",
    "Mode",
    "Parameter",
    "ParameterError",
    "ReachingLaw",
    "Recording",
    "Reference",
    "Robot",
    "Signal",
    "Status",
    "Surface",
    "Trajectory",
    "UsageError",
    "arm_law",
    "batch",
    "compose",
    "inverse_dynamics",
    "make_controller",
    "make_experiment",
    "own_law",
    "register",
    "rollout",
    "sampled_disturbance",
    "sampled_reference",
    "scenario_names",
]


_OFFERED = ("check_gains",)
"""Names that a package above this one offers, through the entry points `pidtsm_core.names` in its setup.py."""


def __getattr__(name: str) -> Any:
    if name in _OFFERED:
        from importlib.metadata import entry_points  # Slow to import.

        for offered in entry_points(group="pidtsm_core.names", name=name):
            return offered.load()
    if name not in _MODULES:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
