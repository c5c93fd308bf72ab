"""Diagnostics of a node's loop, published on /diagnostics once per second."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import QoSProfile

from pidtsm_core.parameters import Value, as_float
from pidtsm_core.robots import DESCRIPTION, find_robot
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp

_PERIOD = 1.0  # s
_CURES = {"missed": "lower the rate of the joint states, or free processors"}
"""What to do about a value beyond a threshold, by its name, where that is the same for every loop."""


@dataclass(frozen=True)
class Reading:
    """One value of a node's loop.

    Attributes:
        name: displayed key.
        value: displayed value.
        unit: displayed after the name.
        threshold: the value is compared with the parameters ``diagnostics.THRESHOLD.warn`` and ``.error``; empty: it
            is not judged.
    """

    name: str
    value: float
    unit: str = ""
    threshold: str = ""


def judge(readings: list[Reading], values: Mapping[str, Value], scale: float = 1.0) -> tuple[bytes, str]:
    """Level and summary of the readings, judged by the node's threshold parameters.

    Thresholds in seconds are multiplied by `scale`.
    """
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
                cure = _CURES.get(reading.threshold, "")
                measured = f"{reading.value:.3g}{reading.unit and ' ' + reading.unit}"
                causes.append(f"{reading.name} {measured} >= {bound:g}{cure and ': ' + cure}")
                break
    return level, "; ".join(causes) or "running"


def loop_readings(statistics: LoopStatistics, judged: bool) -> list[Reading]:
    """Readings of the last second, the same for every loop.

    `judged`: compare them with the thresholds, which apply to loops that follow the wall clock.
    """
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
    """Publishes a node's readings; create it while the node is configured."""

    def __init__(self, node: ManagedNode) -> None:
        """Args: node: the node that owns the loop."""
        self._node = node
        self._publisher = node.advertise(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self._next = 0.0

    @property
    def due(self) -> bool:
        """Whether a second has passed since the last message."""
        return time.monotonic() >= self._next

    def publish(
        self,
        readings: list[Reading],
        idle: str = "",
        idle_level: bytes = DiagnosticStatus.WARN,
        scale: float = 1.0,
    ) -> None:
        """Publish the readings.

        Args:
            readings: values to publish.
            idle: why the loop does not run normally; empty if it does.
            idle_level: diagnostic level in that case.
            scale: see `LoopStatistics.scale`.
        """
        self._next = time.monotonic() + _PERIOD
        readings = [*readings, Reading("messages rejected since the start", self._node.rejected)]
        if idle:
            level, message = idle_level, idle
        else:
            level, message = judge(readings, self._node.values, scale)
        received, rivals = self._node.rivals
        if rivals:
            level, message = (
                max(level, DiagnosticStatus.ERROR if received else DiagnosticStatus.WARN),
                f"{rivals}; {message}",
            )
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: loop",
            message=message,
            hardware_id=find_robot(self._node.values).name if self._node.values.get(DESCRIPTION.name) else "",
            values=[
                KeyValue(key=r.name + (f" ({r.unit})" if r.unit else ""), value=f"{r.value:.6g}") for r in readings
            ],
        )
        array = DiagnosticArray(status=[status])
        set_stamp(array.header.stamp, time.time_ns())
        self._publisher.publish(array)
