"""Data of a run as arrays, from a rollout or a recorded bag."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.control.findings import Finding, as_json
from pidtsm_core.parameters import Value
from pidtsm_core.recording.metrics import finite, metrics, tracking_error
from pidtsm_core.recording.outcome import GROUND_TRUTH, happenings, time_at_limits
from pidtsm_core.recording.provenance import commit_at_start
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.signals import Signal
from pidtsm_core.units import SLIDES, JointUnits, joint_units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

Stamps: TypeAlias = NDArray[np.int64]
"""ns."""

Codes: TypeAlias = NDArray[np.uint8]

_LAW = "law."
"""Prefix of the names of a law's parameters, and of its own name."""


class _OfController:
    """A row of `Recording.signals` by name."""

    def __init__(self, signal: Signal) -> None:
        self.signal = signal

    def __get__(self, recording: "Recording", owner: type["Recording"]) -> Array:
        return recording.signals[:, self.signal]


@dataclass(frozen=True, repr=False)
class Recording:
    """Data of a run, from a rollout or a bag; row k of every array belongs to time[k].

    Attributes:
        joints: names, in the order of the ground truth.
        time: time since the first stamp of the ground truth, s, shape (samples,).
        stamps_ns: header stamps, ns, shape (samples,), increasing.
        position, velocity: true q and q', shape (samples, joints), in the units of `units` and those per second.
        effort: effort applied from time[k] on, shape (samples, joints), in the units of `units`.
        reference: q_d, q_d', q_d'', shape (samples, 3, joints), likewise.
        signals: values that the controller computed from the measurement of this sample; if none reached it, the last
            ones, shape (samples, len(Signal), joints), order of `Signal`.
        status: status of the controller, likewise, shape (samples, len(Status)), order of `Status`; 0 for values that
            the recorded version of the message does not have. A fault's joint counts from 1 in the order of `joints`.
        compute_time: compute time of each command, s, shape (samples,), or (0,) if not measured.
        scenario, law, clock: names; None if the bag does not contain them.
        event_time: time of an event that changed the arm, s, on the axis of `time`; None without an event.
        lost: number of ground truth stamps without a matching message, by recorded topic. Stamps without any message
            are measurements lost at the sensor and not counted, nor are references during a simulated loss.
        rejected: number of rejected messages by node name; None if the bag does not contain it.
        slides: whether each joint slides; empty: all turn, or it is not known.
        continuous: whether each joint turns without end; empty: none does, or it is not known.
        robot: parameters of the simulated arm, for `find_robot`; empty if the bag does not contain them.
        truth: what position, velocity and effort are: `GROUND_TRUTH`, or, if the bag has none, what was measured.
        found: what the controller has found out about its arm by the end; None if nothing, or if it is not known.
        lacking: topics that the bag does not have; what they would contain is 0 above.
        parameters: every parameter of every node as it was used, by node and name, such as
            ``parameters["controller"]["law.k1"]``; empty if they are not known.
        version: of pidtsm that made the run; None if it is not known.
        recorded_commit: see `commit`; None: this process has made the run, empty: it is not known.
        sliding_variable, manifold_variable, adaptive_gain, switching_term: rows of `signals` by name, shape
            (samples, joints) each; `Signal` has their units.
        estimated_position, estimated_velocity, estimated_acceleration: likewise.
        estimated_error, estimated_velocity_error: likewise.
        acceleration_command, equivalent_effort, commanded_effort, saturated: likewise.
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
    truth: str = GROUND_TRUTH
    lacking: tuple[str, ...] = ()
    found: tuple[Finding, ...] | None = None
    parameters: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    version: str | None = None
    recorded_commit: str | None = ""

    estimated_position = _OfController(Signal.POSITION)
    estimated_velocity = _OfController(Signal.VELOCITY)
    estimated_acceleration = _OfController(Signal.ACCELERATION)
    estimated_error = _OfController(Signal.POSITION_ERROR)
    estimated_velocity_error = _OfController(Signal.VELOCITY_ERROR)
    sliding_variable = _OfController(Signal.SLIDING_VARIABLE)
    manifold_variable = _OfController(Signal.MANIFOLD_VARIABLE)
    adaptive_gain = _OfController(Signal.ADAPTIVE_GAIN)
    switching_term = _OfController(Signal.SWITCHING_TERM)
    acceleration_command = _OfController(Signal.ACCELERATION_COMMAND)
    equivalent_effort = _OfController(Signal.EQUIVALENT_EFFORT)
    commanded_effort = _OfController(Signal.EFFORT)
    saturated = _OfController(Signal.SATURATED)

    @property
    def error(self) -> Array:
        """True e = q - q_d, shape (samples, joints), in the units of `units`; see `tracking_error`."""
        return tracking_error(self.position, self.reference[:, 0], self.continuous)

    @property
    def desired(self) -> Array:
        """q_d, rad or m, shape (samples, joints); of a continuous joint with whole turns, as `error` has none."""
        return self.position - self.error if any(self.continuous) else self.reference[:, 0]

    @property
    def units(self) -> tuple[JointUnits, ...]:
        """Units of each joint."""
        return joint_units(self.slides, len(self.joints))

    @property
    def duration(self) -> float:
        """Duration, s; the last sample lasts for the median of the periods."""
        periods = np.diff(self.stamps_ns)
        last = round(float(np.median(periods))) if periods.size else 0
        return (int(self.stamps_ns[-1] - self.stamps_ns[0]) + last) / 1e9

    @property
    def side(self) -> str:
        """The side of elastic joints that position, velocity and error are of, ``link`` or ``motor``; empty: rigid."""
        if not np.any(np.asarray(self.robot.get("elasticity.stiffness", 0.0))):
            return ""
        return "link" if self.truth == GROUND_TRUTH else str(self.robot["elasticity.encoder"])

    @property
    def gains(self) -> dict[str, Value]:
        """Parameters of the control law by name without ``law.``, such as ``gains["k1"]``; empty if not known.

        Their units are those of the parameters; those of a joint are one number for all, or a sequence in the order of
        the controller's joints.
        """
        values = self.parameters.get("controller", {})
        return {name.removeprefix(_LAW): value for name, value in values.items() if name.startswith(_LAW)}

    @property
    def seed(self) -> int | None:
        """Seed of all random numbers of the run; None if it is not known."""
        seed = self.parameters.get("simulator", {}).get("seed")
        return None if seed is None else int(str(seed))

    @property
    def commit(self) -> str | None:
        """Commit of the source that made the run, with ``+changes`` if files differed from it; None if not known."""
        return commit_at_start() if self.recorded_commit is None else self.recorded_commit or None

    def metrics(self) -> dict[str, Any]:
        """Metrics of the run, with the content and order of metrics.json; None for what is missing or not finite.

        Values per joint are lists in the order of `joints`; `pidtsm_core.recording.metrics.metrics` describes most of
        them.
        """
        periods = np.diff(self.stamps_ns)
        computed = self.compute_time
        p50, p99, longest = np.percentile(computed, (50, 99, 100)).tolist() if computed.size else (None, None, None)
        values = {
            "scenario": self.scenario,
            "law": self.law,
            "clock": self.clock,
            "duration": self.duration,
            "samples": self.time.size,
            "joints": list(self.joints),
            "slides": [units == SLIDES for units in self.units],
            "truth": self.truth,
            "side": self.side,
            "lacking": list(self.lacking),
            **happenings(self),
            **metrics(self.time, self.error, self.effort, self.saturated, self.event_time),
            **time_at_limits(self),
            "adaptive_gain": self.adaptive_gain[-1].tolist(),
            "lost": dict(self.lost),
            "found": None if self.found is None else [as_json(each) for each in self.found],
            "rejected": None if self.rejected is None else dict(self.rejected),
            "timing": {
                "rate": 1e9 / float(np.mean(periods)) if periods.size else None,
                "period_max": int(periods.max()) / 1e9 if periods.size else None,
                "compute_time": {"p50": p50, "p99": p99, "max": longest},
            },
        }
        return {name: finite(value) for name, value in values.items()}

    def arrays(self) -> dict[str, Array]:
        """True motion, reference and the controller's signals by name, shape (samples, joints) each, in SI units."""
        signals = {name: each for name, each in vars(Recording).items() if isinstance(each, _OfController)}
        return {
            "position": self.position,
            "velocity": self.velocity,
            "error": self.error,
            "effort": self.effort,
            "reference": self.desired,
            "reference_velocity": self.reference[:, 1],
            "reference_acceleration": self.reference[:, 2],
            **{name: getattr(self, name) for name in signals},
        }

    def to_pandas(self) -> "DataFrame":
        """The `arrays` as a table: one row per sample, with `time` as index, and columns (name, joint).

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        pandas, arrays = _optional("pandas"), self.arrays()
        columns = {(name, joint): arrays[name][:, i] for name in arrays for i, joint in enumerate(self.joints)}
        table: DataFrame = pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))
        return table.rename_axis(columns=["quantity", "joint"])

    def to_xarray(self) -> "Dataset":
        """The `arrays` with the dimensions ``time`` and ``joint``, and the units of each joint as coordinates.

        Raises:
            ModuleNotFoundError: xarray is not installed.
        """
        units = {f"{name}_unit": ("joint", [getattr(unit, name) for unit in self.units]) for name in JointUnits._fields}
        table: Dataset = _optional("xarray").Dataset(
            {name: (("time", "joint"), array) for name, array in self.arrays().items()},
            {"time": self.time, "joint": list(self.joints), **units},
        )
        made = {"version": str(self.version), "commit": str(self.commit), "seed": str(self.seed)}
        return table.assign_attrs(scenario=str(self.scenario), law=str(self.law), **made, gains=str(self.gains))

    def plot(self, figure: "Figure | None" = None) -> "Figure":
        """Draw position with reference, error and effort over time, one column of axes per joint.

        Args:
            figure: result of `plot` for another run, to draw into; None: a new one.

        Raises:
            ModuleNotFoundError: Matplotlib is not installed.
            ValueError: the figure is of an arm with another number of joints.
        """
        joints = len(self.joints)
        if figure is None:
            figure = _optional("matplotlib.pyplot").figure(figsize=(1.0 + 4.0 * joints, 7.0), layout="constrained")
            figure.subplots(3, joints, sharex=True)
        if len(figure.axes) != 3 * joints:
            raise ValueError(f"figure: it has {len(figure.axes)} axes; this run needs {3 * joints}")
        for i, (joint, unit) in enumerate(zip(self.joints, self.units, strict=True)):
            position, error, effort = figure.axes[i::joints]
            (line,) = position.plot(self.time, self.position[:, i], label=str(self.law))
            position.plot(self.time, self.desired[:, i], "--", color="0.5", linewidth=1.0)
            error.plot(self.time, self.error[:, i], color=line.get_color())
            effort.plot(self.time, self.effort[:, i], color=line.get_color())
            position.set(title=joint, ylabel=f"position and reference [{unit.position}]")
            error.set(ylabel=f"error [{unit.position}]")
            effort.set(ylabel=f"effort [{unit.effort}]", xlabel="time [s]")
        figure.axes[0].legend()
        return figure

    def __repr__(self) -> str:
        arm = self.robot.get(DESCRIPTION.name, DESCRIPTION.default if self.robot else "unknown arm")
        errors = zip(np.sqrt(np.mean(self.error**2, axis=0)), self.units, strict=True)
        rmse = ", ".join(f"{error:.3g} {unit.position}" for error, unit in errors)
        return f"<Recording of {arm}: {self.scenario}, {self.law}, {self.duration:g} s, RMSE {rmse}>"


def _optional(module: str) -> Any:
    """Import a module that only some functions need.

    Raises:
        ModuleNotFoundError: it is not installed; the message shows how to install it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError:
        package = module.partition(".")[0]
        raise ModuleNotFoundError(f"this needs {package}: python -m pip install {package}", name=package) from None
