"""The closed loop without ROS: the compiled functions of the nodes in one compiled loop."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core import __version__
from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import lend
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.compiling.events import first_compilation
from pidtsm_core.compiling.memory import Layout
from pidtsm_core.control import Controller, ControllerConfig, ControllerState, copy_signals, step
from pidtsm_core.control.findings import findings
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.parameters import ParameterError, Value, as_float, names
from pidtsm_core.parameters.joints import JointOrder
from pidtsm_core.recording import Recording
from pidtsm_core.references import (
    MotionConfig,
    ReferenceMotion,
    drops_out,
    evaluate_motion,
)
from pidtsm_core.robots import find_robot, robot_parameters
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.signals import Signal, Status
from pidtsm_core.simulation.simulator import SimulatedRobot, act, sense
from pidtsm_core.simulation.simulator_state import SimulatorConfig, SimulatorState
from pidtsm_core.timing import LONGEST_RUN, period_nanoseconds, seconds

Places = NDArray[np.int64]


class _Samples(NamedTuple):
    """The arrays of a rollout while it is simulated; see `Recording`.

    `signals` and the joint of `status` are in the order of the controller, `reference` is in that of the trajectory.
    """

    time: Array
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array
    status: NDArray[np.uint8]


class _Loop(NamedTuple):
    """Controller, robot and desired motion in the form that compiled code reads and changes."""

    controller: ControllerConfig
    state: ControllerState
    hardware: SimulatorConfig
    robot: SimulatorState
    motion: MotionConfig
    places: Places  # of the controller's joints among the simulator's and the trajectory's, shape (2, joints)
    period: int  # ns


def _example() -> _Loop:
    return _prepared(make_experiment(None).values, 0.001)[0]


_LAYOUT = Layout(_example)
_copy = _LAYOUT.copy


@inlined
def _keep(samples: _Samples, start: int, stop: int, config: ControllerConfig, controller: ControllerState) -> None:
    """Fill the rows from `start` to before `stop` with the last result of the controller."""
    last = controller.status
    for k in range(start, stop):
        copy_signals(config, controller, samples.signals[k])
        for i in range(last.size):
            samples.status[k, i] = last[i]


@inlined
def _observe(loop: _Loop, samples: _Samples, k: int, elapsed: float) -> None:
    """Record the motion of the arm at sample k, and the desired motion `elapsed` (s) after the reference began."""
    arm = loop.robot.arm
    evaluate_motion(loop.motion, elapsed, samples.reference[k])
    for j in range(arm.position.size):
        samples.position[k, j] = arm.position[j]
        samples.velocity[k, j] = arm.derivatives[0, j]


@inlined
def _refer(loop: _Loop, desired: Array) -> None:
    """Pass a reference to the controller; `desired` is in the order of the trajectory, shape (3, joints)."""
    reference, places = loop.state.reference, loop.places[1]
    for i in range(3):
        for j in range(reference.shape[1]):
            reference[i, j] = desired[i, places[j]]
    for j in range(places.size):
        loop.state.feedforward[j] = loop.motion.feedforward[places[j]]


@inlined
def _answer(loop: _Loop, sample: int, referred: int, measured: Array, derivatives: Array, applied: Array) -> None:
    """Run one step of the controller; its command is in ``loop.state.torque``, in the order of the simulator.

    Args:
        loop: the loop, which is read and changed.
        sample: sample at which the measurement was acquired.
        referred: stamp of the last reference, ns.
        measured: see `sense`.
        derivatives: likewise.
        applied: likewise.
    """
    state, places = loop.state, loop.places
    for j in range(measured.size):
        place = places[0, j]
        state.measured[j] = measured[place]
        if loop.controller.feeds_back:
            state.applied[j] = applied[place]
        state.truth[0, j] = derivatives[0, place]
        state.truth[1, j] = derivatives[1, place]
    step(loop.controller, state, sample * loop.period, referred)
    for j in range(measured.size):
        state.torque[places[0, j]] = state.output[j]


@njit
def _simulate(address: int, draws: Array, results: _Samples) -> int:
    """Run the loop; return the number of samples with finite values.

    Args:
        address: of a `_Loop`, whose arrays are read and changed.
        draws: random numbers of `Randomness`, one row per sample.
        results: filled.
    """
    loop, samples = _copy(address), lend(results)
    period, arm, state = loop.period, loop.robot.arm, loop.state
    dt = seconds(period)
    last = -1  # sample of the last measurement that reached the controller
    begun = 0  # sample at which the reference begins: that of the first measurement that is not lost
    referred = -1  # stamp of the last reference
    for k in range(samples.time.size):
        for j in range(arm.position.size):
            if not math.isfinite(arm.position[j]):
                return k
        t = seconds(k * period)
        samples.time[k] = t
        # Divisions are the most expensive operations here.
        elapsed = t if begun == 0 else seconds((k - begun) * period)
        _observe(loop, samples, k, elapsed)
        sample, measured, derivatives, applied = sense(loop.hardware, loop.robot, draws[k], k)
        if sample >= 0:
            if last < 0 and sample > 0:
                begun = sample
                for i in range(k + 1):
                    evaluate_motion(loop.motion, seconds((i - begun) * period), samples.reference[i])
            if sample > last + 1:
                _keep(samples, last + 1, sample, loop.controller, state)
            if sample < k:
                elapsed = seconds((sample - begun) * period)
            if not drops_out(loop.motion, elapsed):
                referred = sample * period
                _refer(loop, samples.reference[sample])
            _answer(loop, sample, referred, measured, derivatives, applied)
            _keep(samples, sample, sample + 1, loop.controller, state)
            last = sample
        act(loop.hardware, loop.robot, draws[k], k, sample >= 0, state.torque, t, dt)
        for j in range(arm.position.size):
            samples.effort[k, j] = arm.effort[j]
    _keep(samples, last + 1, samples.time.size, loop.controller, state)
    return samples.time.size


def _run(loop: _Loop, draws: Array, samples: _Samples) -> int:
    """Put the loop into memory and simulate it; see `_simulate`."""
    stored = _LAYOUT.store(loop)
    return _simulate(stored.address, draws, samples)


class DivergedError(RuntimeError):
    """A value of the loop is no longer finite; the message gives the time."""


def rollout(
    scenario: str | Experiment | None = None,
    law: str | None = None,
    params: str | Sequence[str] = (),
    robot: str | ArmDefinition | None = None,
    *,
    duration: float | None = None,
    controller: Mapping[str, Any] | None = None,
    simulator: Mapping[str, Any] | None = None,
    trajectory: Mapping[str, Any] | None = None,
) -> Recording:
    """Simulate the closed loop of controller, robot and trajectory.

    Args:
        scenario: a name from `scenario_names`, the path of a scenario file, or an `Experiment`; None: Case 1 of the
            article, or for another robot (also one given by parameters) a motion within its limits.
        law: name of the control law; None: that of the scenario or of `params`, else ``piddtsm``.
        params: ``article`` (Table 1 of the article), ``practical`` (for real sensors and drives), the path of a ROS
            parameter file, or several of these, of which later ones override earlier ones.
        robot: the arm: a name such as ``panda`` or that of a stored arm, the path of a URDF, xacro or MJCF file, or an
            `ArmDefinition`, which also chooses its joints, its effort limits and what it carries; None: that of the
            scenario.
        duration: s; None: that of the scenario.
        controller: parameters that override all others, by name, such as ``{"law.k1": 3.0}``; a joint's parameter is
            one number for all joints, or one for each. Parameters that only a node has change nothing.
        simulator: likewise.
        trajectory: likewise.

    Returns:
        All arrays of the run, with rows of shape (joints,) in the order of the simulator.

    Raises:
        UsageError: an unknown name, an unreadable file, or (`ParameterError`) a refused value, joints that differ, a
            refused start, a duration that is no finite time of at least one sample, or too long for the memory.
        DivergedError: a value of the loop is no longer finite.
    """
    given = {"controller": controller or {}, "simulator": simulator or {}, "trajectory": trajectory or {}}
    experiment = make_experiment(scenario, law, duration, params, given, robot)
    values = experiment.values
    with first_compilation():
        loop, draws, samples = _prepared(values, experiment.duration)
        done = _run(loop, draws, samples)
    if done < samples.time.size:
        raise DivergedError(f"the loop is not finite any more after {seconds(done * loop.period):g} s")
    _reorder(samples, {node: names(values[node]["joints"]) for node in values})
    return _recording(experiment, values, loop, samples)


def make_controller(
    scenario: str | Experiment | None = None,
    law: str | None = None,
    params: str | Sequence[str] = (),
    robot: str | ArmDefinition | None = None,
    *,
    rate: int = 1000,
    controller: Mapping[str, Any] | None = None,
) -> Controller:
    """Build the controller of a rollout, to be called in a loop of one's own, where nothing is compiled any more.

    Args:
        scenario: as for `rollout`.
        law: likewise.
        params: likewise.
        robot: likewise.
        rate: of the loop, Hz; ``practical`` gains of an arm from a file depend on it.
        controller: as for `rollout`.

    Raises:
        UsageError: see `rollout`.
    """
    given = {"controller": controller or {}, "simulator": {"rate": rate}}
    alone = MEASUREMENT._replace(nodes=("controller",))
    built = Controller(make_experiment(scenario, law, None, params, given, robot, purpose=alone).values["controller"])
    built.compile()
    return built


def _prepared(values: Mapping[str, Mapping[str, Value]], duration: float) -> tuple[_Loop, Array, _Samples]:
    """The loop at its start, random numbers, one row per sample, and arrays for the samples.

    Raises:
        ParameterError: the start, the duration or its memory, see `rollout`.
    """
    controller = Controller(values["controller"])
    robot = SimulatedRobot(values["simulator"], ESTIMATORS[str(values["controller"]["estimator.name"])].needs_truth)
    motion = ReferenceMotion(values["trajectory"])
    order = JointOrder(names(values["controller"]["joints"]))
    places = np.array([order.match(names(values[node]["joints"])) for node in ("simulator", "trajectory")])
    _check_start(controller, robot, motion, places)
    period = period_nanoseconds(int(as_float(values["simulator"]["rate"])))
    if not duration * 1e9 / period >= 0.5 or duration > LONGEST_RUN:
        raise ParameterError(f"duration: {duration} s is not a time from one sample to {LONGEST_RUN:g} s")
    count = round(duration * 1e9 / period)
    samples = _blank(robot.joints, count)
    loop = _Loop(
        controller=controller.config,
        state=controller.state,
        hardware=robot.config,
        robot=robot.state,
        motion=motion.config,
        places=places,
        period=period,
    )
    return loop, robot.randomness.draw(count), samples


def _recording(
    experiment: Experiment, values: Mapping[str, Mapping[str, Value]], loop: _Loop, samples: _Samples
) -> Recording:
    """The samples as a recording that knows what has made it; `values`: of the experiment."""
    arm, units = find_robot(values["simulator"]), find_robot(values["controller"]).units
    return Recording(
        joints=names(values["simulator"]["joints"]),
        **samples._asdict(),
        stamps_ns=np.arange(samples.time.size) * loop.period,
        compute_time=np.empty(0),
        scenario=experiment.scenario,
        law=experiment.law,
        clock=None,
        event_time=experiment.event_time,
        slides=arm.slides,
        continuous=arm.continuous,
        robot=robot_parameters(values["simulator"]),
        found=findings(loop.controller, loop.state, names(values["controller"]["joints"]), units) or None,
        parameters=values,
        version=__version__,
        recorded_commit=None,
    )


def _reorder(samples: _Samples, joints: Mapping[str, tuple[str, ...]]) -> None:
    """Bring the samples into the order of the simulator's joints; `joints` are the names by node."""
    order = joints["simulator"]
    for node, table in (("controller", samples.signals), ("trajectory", samples.reference)):
        if joints[node] != order:
            table[:] = table[..., JointOrder(order).match(joints[node])]
    # Counted from 1, because 0 means no single joint.
    places = np.array([0, *(order.index(joint) + 1 for joint in joints["controller"])])
    samples.status[:, Status.FAULT_JOINT] = places[samples.status[:, Status.FAULT_JOINT]]


def _check_start(controller: Controller, robot: SimulatedRobot, motion: ReferenceMotion, places: Places) -> None:
    """Check that the controller accepts the start.

    Raises:
        ParameterError: the arm starts too far from its reference.
    """
    controller.position[:] = robot.state.arm.position[places[0]]
    controller.reference[:] = motion.start()[:, places[1]]
    if refusal := controller.refusal(referred=not motion.drops_out(0.0)):
        raise ParameterError(f"simulator: initial_position: {refusal}", "simulator.initial_position")


def _blank(joints: int, count: int) -> _Samples:
    """Allocate the arrays for the samples.

    Raises:
        ParameterError: they do not fit in memory.
    """
    # Including the random numbers.
    size = count * (8 * (1 + joints * (3 + 3 + len(Signal)) + 5 + joints) + len(Status))
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if size > memory:
        raise ParameterError(
            f"duration: a rollout of {count} samples takes {size / 1e9:.3g} GB of memory; this machine has "
            f"{memory / 1e9:.3g} GB"
        )
    return _Samples(
        time=np.empty(count),
        position=np.empty((count, joints)),
        velocity=np.empty((count, joints)),
        effort=np.empty((count, joints)),
        reference=np.empty((count, 3, joints)),
        signals=np.empty((count, len(Signal), joints)),
        status=np.empty((count, len(Status)), dtype=np.uint8),
    )
