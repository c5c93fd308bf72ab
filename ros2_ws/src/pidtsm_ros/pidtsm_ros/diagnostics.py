"""What a node says about its loop on /diagnostics, once a second."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import QoSProfile

from pidtsm_core.parameters import Value, as_float
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp

_PERIOD = 1.0  # s


@dataclass(frozen=True)
class Reading:
    """One value of a node's loop.

    Attributes:
        name: shown as the key.
        value: shown.
        unit: shown after the value.
        threshold: ``diagnostics.THRESHOLD.warn`` and ``.error`` are the parameters it is judged by; not where empty.
    """

    name: str
    value: float
    unit: str = ""
    threshold: str = ""


def judge(readings: list[Reading], values: Mapping[str, Value], scale: float = 1.0) -> tuple[bytes, str]:
    """Level and summary of readings, by the thresholds among a node's parameters; those of time times `scale`."""
    level, causes = DiagnosticStatus.OK, []
    for reading in readings:
        if not reading.threshold:
            continue
        for limit, worse in (("error", DiagnosticStatus.ERROR), ("warn", DiagnosticStatus.WARN)):
            bound = as_float(values[f"diagnostics.{reading.threshold}.{limit}"]) * (
                scale if reading.unit == "s" else 1.0
            )
            if reading.value > 0.0 and reading.value >= bound:
                level = max(level, worse)
                causes.append(f"{reading.name} {reading.value:.3g}{reading.unit and ' ' + reading.unit} >= {bound:g}")
                break
    return level, "; ".join(causes) or "running"


def loop_readings(statistics: LoopStatistics, judged: bool) -> list[Reading]:
    """What every loop says of its last second; `judged` by the thresholds where the loop follows the wall clock."""
    window = statistics.last
    return [
        Reading("rate", window.rate, "1/s"),
        Reading("period jitter", window.jitter, "s", "jitter" if judged else ""),
        Reading("longest period", window.longest_period, "s"),
        Reading("missed deadlines", window.missed / max(window.ticks, 1), "of the periods", "missed" if judged else ""),
        Reading("missed deadlines since activation", statistics.missed),
        Reading("compute time, longest", window.longest_compute_time, "s"),
    ]


class Diagnostics:
    """Publishes a node's readings; made while the node is configured."""

    def __init__(self, node: ManagedNode) -> None:
        """Args: node: whose loop it is."""
        self._node = node
        self._publisher = node.advertise(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self._next = 0.0

    @property
    def due(self) -> bool:
        """A second has passed since the last time."""
        return time.monotonic() >= self._next

    def publish(
        self,
        readings: list[Reading],
        idle: str = "",
        idle_level: bytes = DiagnosticStatus.WARN,
        scale: float = 1.0,
    ) -> None:
        """Publish.

        Args:
            readings: to be published.
            idle: why the loop does not run as it should, where it does not.
            idle_level: how bad that is.
            scale: see `LoopStatistics.scale`.
        """
        self._next = time.monotonic() + _PERIOD
        readings = [*readings, Reading("messages rejected since the start", self._node.rejected)]
        if idle:
            level, message = idle_level, idle
        else:
            level, message = judge(readings, self._node.values, scale)
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: loop",
            message=message,
            hardware_id=str(self._node.values.get("robot.name", "")),
            values=[
                KeyValue(key=r.name + (f" ({r.unit})" if r.unit else ""), value=f"{r.value:.6g}") for r in readings
            ],
        )
        array = DiagnosticArray(status=[status])
        set_stamp(array.header.stamp, time.time_ns())
        self._publisher.publish(array)
