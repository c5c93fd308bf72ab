"""Runs a loop sample by sample, and keeps what a recorder on the topics of its nodes would see of it."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import as_float, names
from pidtsm_core.parameters.joints import JointOrder
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import DivergedError
from pidtsm_core.signals import Fault, Mode, Status
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_core.timing import period_nanoseconds, seconds
from pidtsm_studies.diagnosis.observed import Observed


def observe(experiment: Experiment) -> Observed:
    """Simulate an experiment; unlike a rollout, it keeps measurements, with the losses, and reported efforts.

    Raises:
        DivergedError: the arm moves too fast for the integration step.
    """
    values = experiment.values
    controller, robot = Controller(values["controller"]), SimulatedRobot(values["simulator"], accelerations=False)
    motion = ReferenceMotion(values["trajectory"])
    joints = names(values["controller"]["joints"])
    order = JointOrder(joints)
    of_robot, of_motion = (order.match(names(values[node]["joints"])) for node in ("simulator", "trajectory"))
    period = period_nanoseconds(int(as_float(values["simulator"]["rate"])))
    count = round(experiment.duration * 1e9 / period)
    desired, effort = np.zeros((3, len(joints))), np.zeros(len(joints))
    rows: list[tuple[int, Array, Array, Array, Array]] = []
    status = []
    for k in range(count):
        sample, measured = robot.sense(k)
        if sample >= 0:
            stamp = sample * period
            controller.position[:] = measured[of_robot]
            controller.state.received[:] = controller.position
            motion.evaluate(seconds(stamp), desired)
            controller.reference[:] = desired[:, of_motion]
            status.append(controller.step(stamp, stamp))
            seen = controller.position.copy(), robot.applied[of_robot]
            rows.append((stamp, *seen, controller.effort.copy(), controller.reference[0].copy()))
            effort[of_robot] = controller.effort
        robot.act(k, sample >= 0, effort)
        if robot.diverged:
            raise DivergedError(f"the arm is too fast at {seconds(k * period):g} s")
    stamps, position, applied_rows, command, reference = (np.array(column) for column in zip(*rows, strict=True))
    states = np.array(status)
    fault = int(states[:, Status.FAULT].max())
    arm = find_robot(values["controller"])
    return Observed(
        joints=joints,
        time=stamps / 1e9,
        position=position,
        effort=applied_rows,
        command=command,
        reference=reference,
        following=states[:, Status.MODE] == Mode.FOLLOWING,
        slides=arm.slides,
        stopped=Fault(fault).name.lower().replace("_", " ") if fault else "",
    )
