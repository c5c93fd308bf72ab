"""A ROS domain of one's own, so that runs disturb neither each other nor other ROS traffic."""

import fcntl
import os
import random
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_HIGHEST = 101  # Above, the ports of a domain may meet those the system hands out.
_FIRST_PORT, _PORTS_A_DOMAIN = 7400, 250  # DDSI-RTPS 2.2, 9.6.1.1.


@contextmanager
def own_domain() -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that nobody on this machine uses, and keep it until the end of the block.

    Raises:
        RuntimeError: every domain is in use.
    """
    domains = list(range(1, _HIGHEST + 1))
    random.shuffle(domains)
    for domain in domains:
        path = Path(tempfile.gettempdir()) / f"pidtsm-domain-{domain}-{os.getuid()}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if _discovery_port_is_free(domain):
                yield domain
                return
    raise RuntimeError(f"all {_HIGHEST} ROS domains of this machine are in use; end other ROS 2 programs")


def _discovery_port_is_free(domain: int) -> bool:
    """Whether no participant listens for others of the domain (all of them share one port)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", _FIRST_PORT + _PORTS_A_DOMAIN * domain))
        except OSError:
            return False
    return True
