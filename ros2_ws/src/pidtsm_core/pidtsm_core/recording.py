"""Data of a run as arrays, from a rollout or a recorded bag."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.metrics import tracking_error
from pidtsm_core.parameters import Array
from pidtsm_core.robots import find_robot
from pidtsm_core.rollout import Rollout
from pidtsm_core.units import JointUnits, joint_units

Stamps: TypeAlias = NDArray[np.int64]
"""ns."""

Codes: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True)
class Recording:
    """Data of a run; row k of every array belongs to time[k].

    Attributes:
        joints: names, in the order of the ground truth.
        time: time since the first stamp of the ground truth, s, shape (samples,).
        stamps_ns: header stamps, ns, shape (samples,), increasing.
        position, velocity: true q and q', shape (samples, joints), in the units of `units` and those per second.
        effort: effort applied from time[k] on, shape (samples, joints), in the units of `units`.
        reference: q_d, q_d', q_d'', shape (samples, 3, joints), likewise.
        signals: values computed by the controller, shape (samples, len(Signal), joints), order of `Signal`.
        status: status of the controller, shape (samples, len(Status)), order of `Status`; 0 for values that the
            recorded version of the message does not have. A fault's joint counts from 1 in the order of `joints`.
        compute_time: compute time of each command, s, shape (samples,), or (0,) if not measured.
        scenario, law, clock: names; None if the bag does not contain them.
        event_time: time of an event that changed the arm, s, on the axis of `time`; None without an event.
        lost: number of ground truth stamps without a matching message, by recorded topic. Stamps without any message
            are measurements lost at the sensor and not counted, nor are references during a simulated loss.
        rejected: number of rejected messages by node name; None if the bag does not contain it.
        slides: whether each joint slides; empty: all turn, or it is not known.
        continuous: whether each joint turns without end; empty: none does, or it is not known.
        robot: parameters of the simulated arm, for `find_robot`; empty if the bag does not contain them.
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
    slides: tuple[bool, ...] = ()
    continuous: tuple[bool, ...] = ()
    robot: Mapping[str, object] = field(default_factory=dict)

    @classmethod
    def of_rollout(cls, rollout: Rollout, scenario: str, law: str, event_time: float | None) -> "Recording":
        """A rollout in the form of a recording, without compute times."""
        robot = find_robot(rollout.robot)
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
            slides=robot.slides,
            continuous=robot.continuous,
            robot=rollout.robot,
        )

    @property
    def error(self) -> Array:
        """True e = q - q_d, shape (samples, joints), in the units of `units`; see `tracking_error`."""
        return tracking_error(self.position, self.reference[:, 0], self.continuous)

    @property
    def desired(self) -> Array:
        """q_d, shape (samples, joints); of a continuous joint with the whole turns that `error` is without."""
        return self.position - self.error if any(self.continuous) else self.reference[:, 0]

    @property
    def units(self) -> tuple[JointUnits, ...]:
        """Units of each joint."""
        return joint_units(self.slides, len(self.joints))
