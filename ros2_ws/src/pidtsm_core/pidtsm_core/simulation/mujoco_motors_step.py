"""A step of MuJoCo with drive trains: the motors of elastic joints, and friction that sticks."""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.simulation.disturbances import add_disturbance
from pidtsm_core.simulation.drivetrain import Drivetrain, DrivetrainState, Kept, Middle, Rub
from pidtsm_core.simulation.drivetrain_step import BRAKING, level_of, rub
from pidtsm_core.simulation.mujoco_plant import advance
from pidtsm_core.simulation.plant_state import PlantConfig, PlantState


@inlined
def advance_motors(config: PlantConfig, state: PlantState, phase: int, t: float, h: float, braked: bool) -> None:
    """One step of MuJoCo of h (s) from t (s), with the payload in a phase; brakes stop the motors."""
    drives, gears, engine, data = config.drivetrain, state.drivetrain, config.mujoco, state.mujoco
    q, dq, torque = state.position, state.derivatives[0], gears.torque
    net, before = gears.middle[Middle.NET], gears.start[Kept.MOTOR]
    motor, speed = gears.motor, gears.motor_velocity
    for j in range(q.size):
        net[j] = gears.external[j]
    add_disturbance(drives.disturbance, t, q, dq, net)
    for j in range(q.size):
        before[j] = motor[j]
        gears.transmitted[j] = torque[j]
        effort = 0.0 if braked else torque[j] - _resist(drives, gears, j, t, h)
        if drives.stiffness[j] > 0.0:
            place, rate = engine.motor_positions[j], engine.motor_velocities[j]
            data.qpos[place], data.qvel[rate], data.force[rate] = motor[j], speed[j], effort
            spring, damper = drives.stiffness[j], drives.damping[j]
            gears.transmitted[j] = spring * (motor[j] - q[j]) + damper * (speed[j] - dq[j])
        else:
            net[j] += effort
    advance(engine, data, phase, net, q, dq)
    for j in range(q.size):
        if braked:
            left = math.exp(-h / BRAKING)
            motor[j] = before[j] + BRAKING * (1.0 - left) * speed[j]
            speed[j] *= left
            if drives.stiffness[j] == 0.0:
                q[j], dq[j] = motor[j], speed[j]
            continue
        if drives.stiffness[j] > 0.0:
            motor[j] = data.qpos[engine.motor_positions[j]]
            speed[j] = data.qvel[engine.motor_velocities[j]]
        else:
            motor[j], speed[j] = q[j], dq[j]
        gears.bristle[j] += motor[j] - before[j]


@inlined
def _resist(drives: Drivetrain, gears: DrivetrainState, j: int, t: float, h: float) -> float:
    """Friction of a joint, N m; a joint whose bristles are bent to their limit slides."""
    friction, speed, rubbing = drives.friction, gears.motor_velocity[j], gears.friction
    rub(drives, gears, j, t, h)
    # As an implicit step: what is proportional to the velocity may be steep.
    torque = rubbing[Rub.DRY, j] + rubbing[Rub.DRAG, j] * speed / (1.0 + h * rubbing[Rub.DRAG, j] / drives.moved[j])
    if friction.stiffness[j] == 0.0:
        return torque
    held = friction.stiffness[j] * gears.bristle[j]
    limit = level_of(drives, gears, j, held)
    if abs(held) > limit:
        held = math.copysign(limit, held)
        gears.bristle[j] = held / friction.stiffness[j]
        return torque + held
    return torque + held + friction.damping[j] * speed / (1.0 + h * friction.damping[j] / drives.moved[j])
