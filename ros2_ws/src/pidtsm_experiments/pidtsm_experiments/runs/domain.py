"""A ROS domain of one's own, so that runs disturb neither each other nor other ROS traffic."""

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pidtsm_experiments.errors import RunError

_HIGHEST = 101  # Above, the ports of a domain may meet those the system hands out.
_FIRST_PORT, _PORTS_A_DOMAIN = 7400, 250  # DDSI-RTPS 2.2, 9.6.1.1.
_SOCKETS = (Path("/proc/net/udp"), Path("/proc/net/udp6"))


@contextmanager
def own_domain() -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that nobody on this machine uses, and keep it until the end of the block.

    Raises:
        RunError: every domain is in use.
    """
    domains = list(range(1, _HIGHEST + 1))
    random.shuffle(domains)
    for domain in domains:
        # A name without a file: it is free again however this process ends, and all users of the machine share it.
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as lock:
            try:
                lock.bind(f"\0pidtsm-domain-{domain}")
            except OSError:
                continue
            if domain not in domains_in_use():
                yield domain
                return
    raise RunError(f"all {_HIGHEST} ROS domains of this machine are in use; end other ROS 2 programs")


def domains_in_use() -> set[int]:
    """Domains in which somebody on this machine has a socket, whatever its address and whoever its owner.

    Every participant has one for discovery and one for messages at ports of its domain, also where it is limited to
    this machine and does not listen at the port that all participants of a domain share.
    """
    return {(port - _FIRST_PORT) // _PORTS_A_DOMAIN for port in _bound_ports()}


def _bound_ports() -> Iterator[int]:
    """Ports of all UDP sockets of this machine."""
    for table in _SOCKETS:
        with suppress(FileNotFoundError):  # Without IPv6 there is one table only.
            for line in table.read_text(encoding="ascii").splitlines()[1:]:
                yield int(line.split()[1].rpartition(":")[2], 16)
