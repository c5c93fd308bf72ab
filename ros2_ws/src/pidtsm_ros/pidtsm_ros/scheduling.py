"""Real-time scheduling of the own process."""

import os
from pathlib import Path

from pidtsm_ros.middleware import RESENDERS


def run_in_real_time(priority: int, threads: str = "") -> str:
    """Give threads of this process, and those they start later, SCHED_FIFO with this priority.

    Those of the middleware that send again get the lowest, see `RESENDERS`.

    Args:
        priority: 1 to 99, the highest.
        threads: how the names of those begin that get it; all where empty.

    Returns:
        Empty, or the reason why that cannot be had.
    """
    try:
        for thread in Path("/proc/self/task").iterdir():
            name = thread.joinpath("comm").read_text()
            if name.startswith(threads):
                its_priority = 1 if name.startswith(RESENDERS) else priority
                os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(its_priority))
    except (OSError, AttributeError) as error:
        return f"SCHED_FIFO is not permitted ({error}): late more often; see ulimit -r or CAP_SYS_NICE"
    return ""
