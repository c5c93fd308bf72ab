"""One ``./pidtsm nodes start`` in each namespace of a domain, which ``./pidtsm nodes stop`` finds."""

import errno
import os
import select
import signal
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.operate.attached import place, ros_domain

_CREDENTIALS = "3i"  # process, user, group
_END_WITHIN = 30.0  # s


def _address(namespace: str) -> str:
    """Name of an abstract socket: it leaves no file behind, and the kernel frees it with the process."""
    return f"\0pidtsm-nodes-{os.getuid()}-{ros_domain()}-{namespace.strip('/')}"


@contextmanager
def claimed(namespace: str) -> Iterator[None]:
    """Be the process that has started the nodes of a namespace, until the end of the block.

    Raises:
        UsageError: another process has started them.
        RunError: the process cannot be found by others.
    """
    with socket.socket(socket.AF_UNIX) as listening:
        try:
            listening.bind(_address(namespace))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise RunError(f"./pidtsm nodes stop could not find these nodes: {error.strerror}") from None
            raise UsageError(
                f"nodes {place(namespace)} are started already; end them with ./pidtsm nodes stop, or choose another "
                "--namespace"
            ) from None
        listening.listen()
        yield


def end_claimed(namespace: str) -> bool:
    """Interrupt the process that has started the nodes of a namespace, and wait for its end.

    Returns:
        Whether there was one.

    Raises:
        RunError: it does not end in time.
    """
    with socket.socket(socket.AF_UNIX) as calling:
        calling.settimeout(_END_WITHIN)
        try:
            calling.connect(_address(namespace))
        except OSError:
            return False
        given = calling.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize(_CREDENTIALS))
        process, user, _ = struct.unpack(_CREDENTIALS, given)
        if user != os.getuid():
            return False
    try:
        watched = os.pidfd_open(process)
    except ProcessLookupError:
        return True
    try:
        signal.pidfd_send_signal(watched, signal.SIGINT)
        if not select.select([watched], [], [], _END_WITHIN)[0]:
            raise RunError(f"process {process} has not ended within {_END_WITHIN:g} s")
    except ProcessLookupError:
        pass
    finally:
        os.close(watched)
    return True
