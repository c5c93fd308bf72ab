"""A separate ROS domain, so that runs disturb neither each other nor other ROS traffic."""

import random
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from domain_coordinator import domain_id

from pidtsm_experiments.errors import RunError

_HIGHEST = 100  # As domain_coordinator; above 101, ports of a domain may overlap with the system's ephemeral ports.
_FIRST_PORT, _PORTS_PER_DOMAIN = 7400, 250  # DDSI-RTPS 2.2, 9.6.1.1.
_SOCKETS = (Path("/proc/net/udp"), Path("/proc/net/udp6"))


@contextmanager
def own_domain() -> Iterator[int]:
    """Reserve a ROS_DOMAIN_ID that is unused on this machine until the end of the block.

    The reservation is that of domain_coordinator, which ROS's own tests use too.

    Raises:
        RunError: every domain is in use.
    """
    domains = list(range(1, _HIGHEST + 1))
    random.shuffle(domains)
    candidates = iter(domains)

    def free() -> int:
        in_use = domains_in_use()
        return next(domain for domain in candidates if domain not in in_use)

    reserved = domain_id(free)
    try:
        domain = reserved.__enter__()
    except RuntimeError:  # No candidate is left.
        raise RunError(f"all {_HIGHEST} ROS domains of this machine are in use; end other ROS 2 programs") from None
    try:
        yield domain
    finally:
        # Without the error of the block: domain_coordinator would take an OSError for a domain that is reserved.
        reserved.__exit__(None, None, None)


def domains_in_use() -> set[int]:
    """Domains in which any process on this machine has a socket, regardless of its address and owner.

    Every participant has a socket for discovery and one for messages at ports of its domain, even if it is limited to
    this machine and does not use the port shared by all participants of a domain.
    """
    return {(port - _FIRST_PORT) // _PORTS_PER_DOMAIN for port in _bound_ports()}


def _bound_ports() -> Iterator[int]:
    """Ports of all UDP sockets of this machine."""
    for table in _SOCKETS:
        with suppress(FileNotFoundError):  # Without IPv6 there is only one table.
            for line in table.read_text(encoding="ascii").splitlines()[1:]:
                yield int(line.split()[1].rpartition(":")[2], 16)
