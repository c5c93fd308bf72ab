"""What is known of each node now: whether it lives, when its last message arrived, and how it ended."""

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

from pidtsm_experiments.live.words import AMBER, GREEN, GREY, RED, Sentence

SAMPLES_WITHIN = 1.5
"""A node that sends every sample counts as silent after this time, s."""
REPORTS_WITHIN = 3.0
"""A node that is known by its diagnostics only, one message per second, counts as silent after this time, s."""


class Condition(Enum):
    """What is known of a node."""

    UNHEARD = "no message yet"
    ALIVE = "alive"
    SUSPENDED = "suspended by this page"
    SILENT = "silent"
    DEAD = "dead"


_COLORS = {
    Condition.UNHEARD: GREY,
    Condition.ALIVE: GREEN,
    Condition.SUSPENDED: AMBER,
    Condition.SILENT: RED,
    Condition.DEAD: RED,
}


def time_of_day(moment: float) -> str:
    """A time of `time.monotonic` as HH:MM:SS of the wall clock."""
    return time.strftime("%H:%M:%S", time.localtime(time.time() - (time.monotonic() - moment)))


@dataclass
class Life:
    """One node. Times are those of `time.monotonic`, s.

    Attributes:
        received: when its last message arrived; None: none has.
        expected: when the next one is late; it is silent afterwards.
        ended: how its process ended; empty: it runs, or is not known.
        found_ended: when that was noticed, half a second later at most.
        suspended: whether the page has suspended its process.
        present: whether it is in the graph. A node that is killed stays there for up to 20 s.
    """

    received: float | None = None
    expected: float = 0.0
    ended: str = ""
    found_ended: float = 0.0
    suspended: bool = False
    present: bool = True

    def condition(self, now: float) -> Condition:
        """What is known at this time."""
        if self.ended:
            return Condition.DEAD
        if self.suspended:
            return Condition.SUSPENDED
        if self.received is None:
            return Condition.UNHEARD
        return Condition.ALIVE if now <= self.expected else Condition.SILENT

    def sentence(self, now: float) -> Sentence:
        """The same in words, with the time of the last message."""
        condition = self.condition(now)
        last = "" if self.received is None else f"last message {time_of_day(self.received)}"
        if condition is Condition.DEAD:
            text = f"dead: {self.ended} at {time_of_day(self.found_ended)}" + (last and f", {last}")
        elif condition is Condition.SILENT and self.received is not None:
            left = "" if self.present else "; it has left the network"
            text = f"silent since {time_of_day(self.received)} ({now - self.received:.0f} s){left}"
        elif condition is Condition.UNHEARD:
            text = "no message yet: it starts, or is not configured" if self.present else "not there"
        else:
            text = condition.value + (last and f", {last}")
        return Sentence(text, _COLORS[condition])


class Lives:
    """The nodes of a system, in the order in which they became known."""

    def __init__(self) -> None:
        self._lives: dict[str, Life] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(tuple(self._lives))

    def __contains__(self, node: str) -> bool:
        return node in self._lives

    def of(self, node: str) -> Life:
        """What is known of a node; it counts as one of the system from now on."""
        return self._lives.setdefault(node, Life())

    def note_message(self, node: str, within: float, now: float | None = None) -> None:
        """A message of a node has arrived; it is alive for `within` s."""
        now = time.monotonic() if now is None else now
        life = self.of(node)
        life.received, life.expected = now, max(life.expected, now + within)

    def end(self, node: str, ended: str, suspended: bool = False, now: float | None = None) -> None:
        """How the process of a node has ended (empty: it runs), and whether it is suspended."""
        life = self.of(node)
        if ended and not life.ended:
            life.found_ended = time.monotonic() if now is None else now
        life.ended, life.suspended = ended, suspended

    def begin(self, node: str) -> None:
        """A node is started (again): nothing is known of the new one."""
        self._lives[node] = Life()

    def forget(self, node: str) -> None:
        """A node is no longer of interest."""
        self._lives.pop(node, None)

    def see(self, present: Collection[str]) -> None:
        """The nodes that are in the graph now."""
        for node, life in self._lives.items():
            life.present = node in present

    def condition(self, node: str) -> Condition:
        """What is known of a node now."""
        return self._lives[node].condition(time.monotonic()) if node in self._lives else Condition.UNHEARD

    def age(self, node: str) -> float | None:
        """Time since the last message of a node, s; None: none has arrived."""
        received = self._lives[node].received if node in self._lives else None
        return None if received is None else time.monotonic() - received

    def trouble(self, node: str) -> str:
        """Why a node cannot answer, as a sentence without its end; empty: nothing is known against it."""
        now, life = time.monotonic(), self._lives.get(node)
        if life is None or life.condition(now) in (Condition.ALIVE, Condition.UNHEARD):
            return ""
        if life.ended:
            return f"{node} {life.ended} at {time_of_day(life.found_ended)}"
        return f"{node} is {life.sentence(now).text}"


class Source:
    """Where the joint states come from: a simulator, or a real arm.

    An arm is simulated once a simulator was seen, and remains so whatever becomes of the simulator. It is real as soon
    as anything else publishes its joint states, and remains so. Until something is seen, it counts as real.
    """

    def __init__(self, namespace: str) -> None:
        """Args: namespace: of the system, beginning with a slash."""
        self._prefix = f"{namespace.rstrip('/')}/"
        self._seen = False
        self.driver = ""
        """Name of what publishes the joint states of a real arm, a full name if it is not in the namespace; empty: it
        is not known."""

    def see(self, simulator: bool, publishers: Collection[str]) -> None:
        """Take what the graph shows.

        Args:
            simulator: whether the namespace has a simulator.
            publishers: full names of those that publish the joint states.
        """
        names = [name.removeprefix(self._prefix) for name in publishers]
        others = [name for name in names if name != "simulator"]
        self._seen = self._seen or simulator or "simulator" in names
        self.driver = others[0] if others else self.driver

    @property
    def simulated(self) -> bool:
        """Whether nobody can be hurt."""
        return self._seen and not self.driver

    @property
    def node(self) -> str:
        """Name of the node that sends the joint states, as in `Lives`; empty: none is known."""
        return "simulator" if self.simulated else self.driver


def how_to_start(node: str, executables: Mapping[str, tuple[str, str]], namespace: str) -> str:
    """What starts a node that the page has not started.

    Args:
        node: its name.
        executables: by node, package and executable.
        namespace: of the system, beginning with a slash.
    """
    if node not in executables:
        return "start it again as it was started"
    package, executable = executables[node]
    return (
        f"start it again as it was started, or with ros2 run {package} {executable} --ros-args "
        f"-r __ns:={namespace} --params-file FILE"
    )
