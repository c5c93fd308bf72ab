"""Seven joints: dynamics next to MuJoCo's and Pinocchio's, a step of the controller, a rollout."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count as count_from
from typing import Any

import mujoco
import numpy as np

from pidtsm_core.control import Controller, Time, controller_schema
from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot, robot_schema, tree
from pidtsm_core.robots.source import read_source
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.commands.bench import Row, medians

try:
    import pinocchio
except ImportError:  # Optional, see requirements/README.md.
    pinocchio = None

ARM = {"robot.description": "panda"}
JOINTS = 7
PERIOD = 1_000_000
"""ns."""

TAKES = 30.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Microseconds per call from Python, all in turns; then milliseconds per rollout."""
    yield from _dynamics(*((1000, 3) if quick else (20_000, 15)))
    yield from _step(*((1000, 3) if quick else (20_000, 15)))
    yield from _rollout(3 if quick else 9)


def _repeated(count: int, call: Callable[..., object], *arguments: object) -> Callable[[], None]:
    """`count` calls from Python."""

    def repeated() -> None:
        for _ in range(count):
            call(*arguments)

    return repeated


JOINTS_AS_THEY_ARE = {
    "elasticity.stiffness": 1e4,
    "elasticity.damping": 5.0,
    "elasticity.encoder": "link",
    "friction.coulomb": 0.5,
    "friction.static": 0.7,
    "friction.bristle_stiffness": 1e4,
    "friction.load": 0.02,
    "friction.cold": 0.3,
    "friction.cogging": 0.05,
}
"""Elastic joints with friction that sticks and depends on load, temperature and position."""


def _dynamics(count: int, repetitions: int) -> Iterator[Row]:
    text = read_source(str(ARM["robot.description"]))[1]
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    packed = find_robot(ARM).pack_model(resolve(robot_schema, ARM, JOINTS))
    q, dq, ddq = np.random.default_rng(0).uniform(-1.0, 1.0, (3, JOINTS))
    effort, result = np.zeros((1, JOINTS)), np.zeros(JOINTS)
    data.qpos[:], data.qvel[:] = q, dq
    functions = [
        _repeated(count, tree.inverse_dynamics, q, dq, ddq[np.newaxis].copy(), packed, effort),
        _repeated(count, tree.forward_dynamics, q, dq, ddq, packed, result),
        _repeated(count, mujoco.mj_forward, model, data),
    ]
    if pinocchio is not None:
        other = pinocchio.buildModelFromXML(text)
        scratch = other.createData()
        functions += [_repeated(count, f, other, scratch, q, dq, ddq) for f in (pinocchio.rnea, pinocchio.aba)]
    inverse, forward, of_mujoco, *of_pinocchio = (t / count * 1e6 for t in medians(repetitions, *functions))
    note = "7 joints, from Python"
    yield Row("forward dynamics", forward, "us", "mj_forward", of_mujoco, forward / of_mujoco, "<= 0.5", note)
    for name, figure, peer in zip(("inverse", "forward"), (inverse, forward), of_pinocchio, strict=False):
        yield Row(f"{name} dynamics", figure, "us", "Pinocchio", peer, figure / peer, "<= 0.6", note)
    if not of_pinocchio:
        yield Row("inverse dynamics", inverse, "us", note=f"{note}; Pinocchio is not installed")


def _step(count: int, repetitions: int) -> Iterator[Row]:
    """A step of the controller with the observer, for seven joints and for two."""
    observed = {"estimator.name": "extended_state_observer"}
    controllers = [
        Controller(resolve(controller_schema, {**observed, **arm}, joints)) for arm, joints in ((ARM, JOINTS), ({}, 2))
    ]

    def steps(controller: Controller) -> None:
        stamps = count_from(controller.state.times[Time.LAST] + PERIOD, PERIOD)
        for _ in range(count):
            stamp = next(stamps)
            controller.step(stamp, stamp)

    seven, two = (t / count * 1e6 for t in medians(repetitions, *(lambda c=c: steps(c) for c in controllers)))
    yield Row(
        "controller step with observer", seven, "us", "two joints", two, seven / two, None, "7 joints, from Python"
    )


def _rollout(repetitions: int) -> Iterator[Row]:
    """30 s with the practical parameters, for seven joints and for two."""
    arms = (ARM["robot.description"], None)
    seven, two = (
        1e3 * t
        for t in medians(repetitions, *(lambda a=a: rollout(params=PRACTICAL, robot=a, duration=30.0) for a in arms))
    )
    yield Row("rollout of 30 s with observer", seven, "ms", "two joints", two, seven / two, note="7 joints, one core")
    chosen: tuple[dict[str, Any], ...] = ({}, JOINTS_AS_THEY_ARE)
    simulate = [partial(rollout, params=PRACTICAL, robot=arms[0], duration=30.0, simulator=each) for each in chosen]
    rigid, elastic = (1e3 * t for t in medians(repetitions, *simulate))
    note = "7 elastic joints that stick, one core"
    yield Row("rollout of 30 s with drive trains", elastic, "ms", "rigid", rigid, elastic / rigid, "<= 2.5", note)
