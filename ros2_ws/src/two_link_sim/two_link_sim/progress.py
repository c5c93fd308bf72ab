"""State that the simulator node keeps between samples, and while it waits for other nodes."""

import time
from dataclasses import dataclass, field

from pidtsm_ros.bursts import Bursts

_SETTLE = 0.3
"""In realtime, time from the last discovered connection to the first sample, s. Other nodes may discover their
connections later. In lockstep each sample waits for its command; in realtime the reference would run ahead of a
controller that is not connected yet."""
_PATIENCE = 3.0
"""Waiting time before a log line about it, and between two such lines, s."""


@dataclass
class Progress:
    """Where the simulation is; times in ns of the monotonic clock, except for the stamp."""

    sample: int = -1  # the one that is simulated; -1 before the first
    acquired: int = -1  # sample of the last measurement sent
    awaits_command: bool = False  # a measurement was sent at this sample
    skipped: int = 0  # samples
    reported: int = -1  # sample at the last diagnostics
    first_stamp: int = 0  # of sample 0, ns
    began: int = 0  # when the first sample was due
    sent: int = 0  # when the last sample was published
    compute_time: float = 0.0  # of the last sample, s
    diverged: Bursts = field(default_factory=Bursts)


@dataclass
class Commands:
    """The commands so far."""

    answered: int = -1  # sample that the last one answers
    begun: bool = False  # there was one
    new: bool = False  # one has arrived since the last sample
    count: int = 0  # samples answered
    stale: Bursts = field(default_factory=Bursts)
    unknown: Bursts = field(default_factory=Bursts)


class Waiting:
    """Waiting for other nodes, and when to log it."""

    def __init__(self) -> None:
        self._reminded = time.monotonic()
        self._connected = 0.0

    def reminds(self) -> bool:
        """Whether a log line is due."""
        now = time.monotonic()
        due = now - self._reminded > _PATIENCE
        if due:
            self._reminded = now
        return due

    def settled(self, connected: bool) -> bool:
        """Whether the other nodes have been connected for `_SETTLE`."""
        if not connected:
            self._connected = 0.0
            return False
        self._connected = self._connected or time.monotonic()
        return time.monotonic() - self._connected > _SETTLE
