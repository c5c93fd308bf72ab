"""Real-time scheduling of this process."""

import os
from contextlib import suppress
from pathlib import Path


def run_in_real_time(priority: int, threads: str = "") -> str:
    """Run threads of this process, and the threads they start later, with SCHED_FIFO at this priority.

    Args:
        priority: 1 to 99; 99 is the highest.
        threads: prefix of the names of the threads; empty: all threads.

    Returns:
        Empty, or the reason why this is not possible.
    """
    try:
        parameters = os.sched_param(priority)
        for thread in Path("/proc/self/task").iterdir():
            if thread.joinpath("comm").read_text().startswith(threads):
                os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, parameters)
    except (OSError, AttributeError) as error:
        return f"SCHED_FIFO is not permitted ({error}), expect more missed deadlines; see ulimit -r or CAP_SYS_NICE"
    return ""


def run_at_normal_priority() -> None:
    """Undo `run_in_real_time`, for all threads."""
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # The thread has ended.
            if os.sched_getscheduler(int(thread.name)) != os.SCHED_OTHER:
                os.sched_setscheduler(int(thread.name), os.SCHED_OTHER, os.sched_param(0))
