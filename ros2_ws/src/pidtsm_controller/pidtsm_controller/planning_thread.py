"""A thread that plans or reads beside the loop of a node."""

import os
from concurrent.futures import ThreadPoolExecutor


def planning_thread(name: str) -> ThreadPoolExecutor:
    """One thread at ordinary priority; by default, a thread inherits the real-time priority of its creator."""
    return ThreadPoolExecutor(1, name, _lower_priority)


def _lower_priority() -> None:
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
