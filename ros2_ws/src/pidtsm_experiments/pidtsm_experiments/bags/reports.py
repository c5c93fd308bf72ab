"""What the nodes have reported on /diagnostics: messages that they rejected, and what the controller has found out."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any, NamedTuple

from pidtsm_core.control.findings import Finding, from_readings

_REJECTED = "messages rejected since the start"  # key used by `pidtsm_ros.diagnostics`
_CONTROLLER = "controller"


class Reported(NamedTuple):
    """The last reports of the nodes."""

    rejected: dict[str, int] | None  # number of messages by the name of the node; None: no node reports one
    found: tuple[Finding, ...] | None  # by the controller; None: it does not report, or has found nothing


def reported(reports: Iterable[Any], namespace: str) -> Reported:
    """What the last report of each node says.

    Args:
        reports: diagnostic_msgs/DiagnosticArray, in chronological order.
        namespace: namespace of the nodes, without slashes at its ends; other nodes publish on the topic too.
    """
    counts: dict[str, int] = {}
    found: tuple[Finding, ...] = ()
    for report in reports:
        for status in report.status:
            place, _, node = status.name.partition(":")[0].rpartition("/")
            if place != namespace:
                continue
            if node == _CONTROLLER:
                found = from_readings((pair.key, pair.value) for pair in status.values)
            for pair in status.values:
                if pair.key == _REJECTED:
                    with suppress(ValueError, OverflowError):
                        counts[node] = round(float(pair.value))
    return Reported(counts or None, found or None)
