"""Real-time scheduling of the own process."""

import os
from pathlib import Path


def run_in_real_time(priority: int, threads: str = "") -> str:
    """Give threads of this process, and those they start later, SCHED_FIFO with this priority.

    Args:
        priority: 1 to 99, the highest.
        threads: how the names of those begin that get it; all where empty.

    Returns:
        Empty, or the reason why that cannot be had.
    """
    try:
        parameters = os.sched_param(priority)
        for thread in Path("/proc/self/task").iterdir():
            if thread.joinpath("comm").read_text().startswith(threads):
                os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, parameters)
    except (OSError, AttributeError) as error:
        return f"SCHED_FIFO is not permitted ({error}): late more often; see ulimit -r or CAP_SYS_NICE"
    return ""
