"""A session on an arm in a process of its own, which a page guides.

    python -m pidtsm_experiments.commissioning.guided

The first line of its input is a `Task`; each line of its output is something that it says, both as JSON. It asks before
each step; a line that is `AGREED` lets the step begin, another one or the end of the input ends the session. SIGINT
brings the arm to rest and ends it. However it ends, the arm is held.
"""

import json
import signal
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commissioning.consent import rows
from pidtsm_experiments.commissioning.kept import bag_keeper, no_bags, write_results
from pidtsm_experiments.commissioning.remote import RemoteArm
from pidtsm_experiments.commissioning.subjects import subject_of
from pidtsm_experiments.errors import RunError
from pidtsm_studies.commissioning.bench import Plan
from pidtsm_studies.commissioning.session import RefusedError, Session

AGREED = "agreed"
ASKS, TELLS, ENDS = "asks", "tells", "ends"
"""Kinds of what it says: a question, a finding, and why it ends."""


@dataclass(frozen=True)
class Task:
    """What a session is of.

    Attributes:
        folder: of the session.
        label: of the arm, for the report.
        values: parameters of the controller before.
        namespace: of the topics.
        words: arguments of ROS.
        first: step to be repeated, with all later ones; empty: none.
        bags: whether the recordings are kept as bags, too.
    """

    folder: str
    label: str
    values: Mapping[str, Any]
    namespace: str = ""
    words: list[str] = field(default_factory=list)
    first: str = ""
    bags: bool = True

    def line(self) -> str:
        """The task as `guided` reads it."""
        return json.dumps(asdict(self), allow_nan=False)


class Asked(NamedTuple):
    """A question: the plan of a step in words, see `Plan` and `consent.rows`."""

    step: str
    text: str
    duration: float
    rows: list[list[str]]


class _Voice:
    """What somebody at a terminal would see and answer, as lines."""

    def __init__(self, answers: TextIO, session: Session, label: str) -> None:
        self._answers, self._session, self._label = answers, session, label

    def ask(self, step: str, plan: Plan) -> bool:
        """Ask whether a step may begin; what is found so far can be read meanwhile."""
        write_results(self._session, self._label)
        shown = [list(row) for row in rows(plan, self._session.subject.arm)]
        say(ASKS, Asked(step, plan.text, plan.duration, shown)._asdict())
        return self._answers.readline().strip() == AGREED

    def tell(self, text: str) -> None:
        """Say what was found."""
        say(TELLS, text)


def say(kind: str, content: Any = None) -> None:
    """Say something."""
    print(json.dumps([kind, content]), flush=True)


def guided(task: Task, answers: TextIO) -> str:
    """Do the missing steps of a session; returns why it has ended, empty if all are done.

    Args:
        task: what is to be done.
        answers: the lines that answer.
    """
    session = Session.opened(Path(task.folder), subject_of(task.values))
    if task.first:
        session.repeat_from(task.first)
    voice = _Voice(answers, session, task.label)
    try:
        with RemoteArm(session.folder, session.subject.arm, task.namespace, task.words) as arm:
            session.run(arm, voice.ask, voice.tell, bag_keeper(session) if task.bags else no_bags)
    except RefusedError:
        return "not agreed"
    except KeyboardInterrupt:
        return "stopped"
    except (UsageError, RunError) as error:
        return str(error)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        write_results(session, task.label)
    return ""


def main() -> None:
    """Run the process."""
    task = Task(**json.loads(sys.stdin.readline()))
    try:
        say(ENDS, guided(task, sys.stdin))
    except UsageError as error:
        say(ENDS, str(error))


if __name__ == "__main__":
    main()
