"""How many messages each node could not use, from what it said on /diagnostics."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

_KEY = "messages rejected since the start"  # as `pidtsm_ros.diagnostics` writes it


def rejections(reports: Iterable[Any], namespace: str) -> dict[str, int] | None:
    """The last count of each node; None where no node has said one.

    Args:
        reports: diagnostic_msgs/DiagnosticArray, in the order they came.
        namespace: of the nodes, without slashes at its ends; others share the topic.
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
