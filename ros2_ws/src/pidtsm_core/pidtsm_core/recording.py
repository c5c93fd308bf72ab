"""What a run leaves, as arrays, be it a rollout or a recorded bag."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.parameters import Array
from pidtsm_core.rollout import Rollout

Stamps: TypeAlias = NDArray[np.int64]
"""ns."""

Codes: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True)
class Recording:
    """What a bag says about a run; row k of every array belongs to time[k].

    Attributes:
        joints: names, in the order of the ground truth.
        time: from the first stamp of the ground truth, s, shape (samples,).
        stamps_ns: header stamps, ns, shape (samples,), increasing.
        position, velocity: true q (rad), q' (rad/s), shape (samples, joints).
        effort: torque applied from time[k] on, N m, shape (samples, joints).
        reference: q_d, q_d', q_d'', shape (samples, 3, joints), rad, rad/s, rad/s^2.
        signals: what the controller computed, shape (samples, len(Signal), joints), order of `Signal`.
        status: what the controller said of itself, shape (samples, len(Status)), order of `Status`; 0 where the
            messages are of a version that did not say it. A fault's joint counts from 1 in the order of `joints`.
        compute_time: of the controller for a command, s, shape (samples,), or (0,) where nobody measured it.
        scenario, law, clock: names, None where the bag does not say.
        event_time: when something happened to the arm, s on the axis of `time`, None without an event.
        lost: number of stamps of the ground truth without a partner, by recorded topic; a stamp without any is that
            of a measurement that never left its sensor, and where the reference was to stay out it is not lost.
        rejected: number of messages that each node could not use, by its name; None where the bag does not say.
    """

    joints: tuple[str, ...]
    time: Array
    stamps_ns: Stamps
    position: Array
    velocity: Array
    effort: Array
    reference: Array
    signals: Array
    status: Codes
    compute_time: Array
    scenario: str | None
    law: str | None
    clock: str | None
    event_time: float | None
    lost: Mapping[str, int] = field(default_factory=dict)
    rejected: Mapping[str, int] | None = None

    @classmethod
    def of_rollout(cls, rollout: Rollout, scenario: str, law: str, event_time: float | None) -> "Recording":
        """A rollout as if it had been recorded; nobody measured compute times."""
        return cls(
            joints=rollout.joints,
            time=rollout.time,
            stamps_ns=np.round(rollout.time * 1e9).astype(np.int64),
            position=rollout.position,
            velocity=rollout.velocity,
            effort=rollout.effort,
            reference=rollout.reference,
            signals=rollout.signals,
            status=rollout.status,
            compute_time=np.empty(0),
            scenario=scenario,
            law=law,
            clock=None,
            event_time=event_time,
        )

    @property
    def error(self) -> Array:
        """True e = q - q_d, rad, shape (samples, joints), eq. (7)."""
        return self.position - self.reference[:, 0]
