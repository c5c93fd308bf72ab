"""Estimator, law and robot model: from measured position and desired motion to effort."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.breakaway import break_away, is_at_rest
from pidtsm_core.control.compliance import yielding_rate
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact, sense_contact
from pidtsm_core.control.effort import feed_offset, held_back, limit_effort, write_net_effort
from pidtsm_core.control.friction_learning import learn_friction
from pidtsm_core.control.joint_friction import friction, press
from pidtsm_core.control.lacking import find_lacking, find_noise
from pidtsm_core.control.late_drives import Predicted
from pidtsm_core.control.lateness import deliver, predict
from pidtsm_core.control.lateness_learning import learn_lateness
from pidtsm_core.control.law_of_arm import advance_law_of_arm, command_law_of_arm
from pidtsm_core.control.softening import soften, write_pace
from pidtsm_core.control.state import Condition, ControllerState, Friction, Handover, Time, part
from pidtsm_core.estimators import DISTURBANCE, Sample, estimate
from pidtsm_core.laws import Demand, Interval, advance, command
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Signal, Status

_ABSURD = 1e15
"""An error or sliding variable that large, or not a number, comes from an absurd position; no law integrates it."""


@inlined
def _advance(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Advance the states of the law over dt (s) with the values of the last tick, eqs. (10), (25), (27)."""
    if config.law.of_arm:
        advance_law_of_arm(config, state, dt)
        return
    y, pace = state.signals, state.pace[0]
    adaptation = state.conditions[Condition.ADAPTATION]
    stopped = state.status[Status.FAULT] != 0 or in_contact(config, state)
    for j in range(y.shape[1]):
        e, sliding, manifold = (
            y[Signal.POSITION_ERROR, j],
            y[Signal.SLIDING_VARIABLE, j],
            y[Signal.MANIFOLD_VARIABLE, j],
        )
        if not (abs(e) < _ABSURD and abs(sliding) < _ABSURD and abs(manifold) < _ABSURD):
            continue
        frozen = stopped or (config.freezes and held_back(config, state, j)) or is_at_rest(state, j)
        advance(
            config.law,
            j,
            e,
            sliding,
            manifold,
            state.law[j],
            Interval(pace * dt, frozen, adaptation),
        )


@part
def _reject(config: ControllerConfig, state: ControllerState) -> None:
    """Update the disturbance that the law rejects; like an integral, it does not grow while the arm cannot follow."""
    touches = in_contact(config, state)
    for j in range(state.rejected.size):
        found = state.estimator[j, DISTURBANCE]
        blocked = touches or (config.freezes and held_back(config, state, j))
        if not blocked or abs(found) < abs(state.rejected[j]):
            state.rejected[j] = found


@inlined
def _command(config: ControllerConfig, state: ControllerState, motion: Array, desired: Array, dt: float) -> None:
    """Write the law's signals and accelerations for a motion and a desired one, both of shape (3, joints)."""
    if config.law.of_arm:
        command_law_of_arm(config, state, dt)
        return
    y, pace = state.signals, state.pace[0]
    slow, square = 1.0 / pace, pace * pace
    for j in range(y.shape[1]):
        e = motion[0, j] - desired[0, j]
        de = motion[1, j] - desired[1, j]
        dde = motion[2, j] - desired[2, j]
        a_cmd, a_eq, s, sigma, gain, tau_sw = command(
            config.law, j, e, slow * de, slow * slow * dde, slow * slow * desired[2, j], state.law[j], pace * dt
        )
        y[Signal.POSITION_ERROR, j] = e
        y[Signal.VELOCITY_ERROR, j] = de
        y[Signal.SLIDING_VARIABLE, j] = s
        y[Signal.MANIFOLD_VARIABLE, j] = sigma
        y[Signal.ADAPTIVE_GAIN, j] = gain
        y[Signal.SWITCHING_TERM, j] = square * tau_sw
        state.accelerations[0, j] = square * a_eq - state.rejected[j]
        state.accelerations[1, j] = square * a_cmd - state.rejected[j]


@inlined
def _add(config: ControllerConfig, state: ControllerState, desired: Array) -> None:
    """Compute the effort beyond the law's: what is fed forward, and what compensates friction and offsets.

    Friction is that of the desired velocity, without that of a reference that yields: at a wall it changes its sign at
    every sample.
    """
    for j in range(desired.shape[1]):
        state.added[j] = state.feedforward_effort[j]
        if config.compensates:
            velocity = desired[1, j] - yielding_rate(state, j)
            state.added[j] += friction(config, velocity, j)
            if config.presses:
                state.added[j] += press(config, state, velocity, j)
        if config.adaptation.compensates_friction:
            state.added[j] += state.friction[Friction.EFFORT, j]
    feed_offset(config, state)


@part
def demand_again(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write what the law, which has changed, would have demanded at the last sample without a limit, to the signals.

    Args:
        config: configuration, which is read.
        state: state, of which only signals change.
        dt: as for the last `tick`.
    """
    motion, desired = state.signals[: Signal.POSITION_ERROR], state.desired
    write_pace(config, state)
    if config.drive.late:
        predict(config, state)  # What is known of the drives may have changed, too.
        motion, desired = state.predicted, state.ahead
    _command(config, state, motion, desired, dt)
    _add(config, state, desired)
    _actuate(config, state, dt, False)


@inlined
def _actuate(config: ControllerConfig, state: ControllerState, dt: float, senses: bool) -> None:
    """Convert the law's accelerations to efforts with the model; the outputs of a law without model are efforts.

    If it `senses`, it also updates what acts on the arm from outside.
    """
    y, motion, efforts = state.signals, state.motion, state.scratch
    q_hat, dq_hat = y[Signal.POSITION], y[Signal.VELOCITY]
    if config.senses_contact and senses:
        for j in range(y.shape[1]):
            motion[2, j] = y[Signal.ACCELERATION, j]
        inverse_dynamics(config.model, q_hat, dq_hat, motion, efforts[:3])
        sense_contact(state, efforts[2], dt)
    elif config.uses_model and not config.drive.late:
        inverse_dynamics(config.model, q_hat, dq_hat, motion[:2], efforts[:2])
    if config.drive.late:
        q, dq = state.predicted[Predicted.POSITION], state.predicted[Predicted.VELOCITY]
        inverse_dynamics(config.model, q, dq, motion[:2], efforts[:2])
    for j in range(y.shape[1]):
        added = state.added[j]
        if config.drive.late:
            added += state.undamped[j]
        if config.uses_model:
            y[Signal.ACCELERATION_COMMAND, j] = motion[1, j]
        else:
            efforts[0, j], efforts[1, j] = motion[0, j], motion[1, j]
        if config.law.of_arm:
            efforts[0, j] += state.demand[Demand.EQUIVALENT_EFFORT, j]
            efforts[1, j] += state.demand[Demand.EFFORT, j]
        y[Signal.EQUIVALENT_EFFORT, j] = efforts[0, j] + added
        y[Signal.EFFORT, j] = efforts[1, j] + added + state.freedrive_effort[j]
        if state.conditions[Condition.HANDOVER] == Handover.FADING:
            y[Signal.EFFORT, j] += state.handover[j]


@inlined
def tick(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write every signal of this sample, including the law's effort within its limit, to ``state.signals``.

    Args:
        config: configuration, which is read.
        state: state, which is changed: ``measured``, ``truth`` (for an estimator with `needs_truth`) and ``desired``
            are those of the sample.
        dt: time since the last tick, s; 0 at the first one.

    If absurd positions cause an overflow, the torque is 0, never infinite or nan.
    The states of the law first advance over dt with the values of the last tick, so an irregular period integrates what
    was really held over it; in freedrive they pause. States that can wind up pause while the applied effort is not the
    law's: at a limit (``law.anti_windup``), and while the controller has stopped. They also pause in contact, see
    contact.py, and at rest where friction is compensated, see breakaway.py.
    """
    y, desired = state.signals, state.desired
    motion = y[: Signal.POSITION_ERROR]
    if config.adaptation.watches_roughness and dt > 0.0:
        soften(config, state, dt)
    write_pace(config, state)
    if dt > 0.0 and state.times[Time.FREED] == 0:
        _advance(config, state, dt)
    if not config.drive.late:
        write_net_effort(state, state.applied if config.feeds_back else y[Signal.EFFORT])
    elif dt > 0.0:
        deliver(config, state, dt)
    sample = Sample(state.measured, state.truth, dt, state.net, config.model, state.pace[0])
    estimate(config.estimator.address, sample, config.estimator.parameters, state.estimator, motion)
    if config.adaptation.learns or config.adaptation.softens:
        find_noise(state, dt)
    if config.adaptation.learns:
        find_lacking(config, state, dt)
    if config.adaptation.learns_lateness and dt > 0.0:
        learn_lateness(config, state, dt)
    if config.breaks_away and dt > 0.0:
        break_away(config, state, dt)
    if config.drive.late:
        predict(config, state)
        motion, desired = state.predicted, state.ahead
    if config.adaptation.learns_friction:
        learn_friction(config, state, dt)
    if config.rejects:
        _reject(config, state)
    _command(config, state, motion, desired, dt)
    _add(config, state, desired)
    _actuate(config, state, dt, True)
    limit_effort(config, state)
