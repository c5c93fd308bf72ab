"""Number of messages that each node rejected, from its reports on /diagnostics."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

_KEY = "messages rejected since the start"  # key used by `pidtsm_ros.diagnostics`


def rejections(reports: Iterable[Any], namespace: str) -> dict[str, int] | None:
    """The last count of each node, by its name; None if no node reports one.

    Args:
        reports: diagnostic_msgs/DiagnosticArray, in chronological order.
        namespace: namespace of the nodes, without slashes at its ends; other nodes publish on the topic too.
    """
    counts: dict[str, int] = {}
    for report in reports:
        for status in report.status:
            place, _, node = status.name.partition(":")[0].rpartition("/")
            for pair in status.values if place == namespace else ():
                if pair.key == _KEY:
                    with suppress(ValueError, OverflowError):
                        counts[node] = round(float(pair.value))
    return counts or None
