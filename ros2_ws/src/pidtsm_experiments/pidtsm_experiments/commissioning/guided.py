"""A session on an arm in a process of its own, which a page guides.

    python -m pidtsm_experiments.commissioning.guided

The first line of its input is a `Task`, each line of its output an event, both as JSON. Before each step it writes the
plan and waits: the line `AGREED` lets the step begin, any other line or the end of the input ends the session. SIGINT
brings the arm to rest and ends it; whoever starts the process blocks it, so that it cannot end the start halfway.
However it ends, the arm is held.
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
STOPPED = "stopped"
"""The reason of an end by SIGINT."""
PLAN, FINDING, END = "plan", "finding", "end"
"""Kinds of events; the last one has the reason of the end."""


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
    """The plan of a step that needs consent, in words, see `Plan` and `consent.rows`."""

    step: str
    text: str
    duration: float
    rows: list[list[str]]


class _Lines:
    """What somebody at a terminal would see and answer, as lines."""

    def __init__(self, answers: TextIO, session: Session, label: str) -> None:
        self._answers, self._session, self._label = answers, session, label

    def ask(self, step: str, plan: Plan) -> bool:
        """Whether a step may begin; the results so far can be read meanwhile."""
        write_results(self._session, self._label)
        shown = [list(row) for row in rows(plan, self._session.subject.arm)]
        write_event(PLAN, Asked(step, plan.text, plan.duration, shown)._asdict())
        return self._answers.readline().strip() == AGREED

    def tell(self, text: str) -> None:
        """Write a finding."""
        write_event(FINDING, text)


def write_event(kind: str, content: Any) -> None:
    """Write an event as a line."""
    print(json.dumps([kind, content]), flush=True)


def guided(task: Task, answers: TextIO) -> str:
    """Do the missing steps of a session; return why it has ended, empty if all are done.

    Args:
        task: what is to be done.
        answers: the lines that answer.
    """
    session = Session.opened(Path(task.folder), subject_of(task.values))
    if task.first:
        session.repeat_from(task.first)
    lines = _Lines(answers, session, task.label)
    try:
        with RemoteArm(session.folder, session.subject.arm, task.namespace, task.words) as arm:
            session.run(arm, lines.ask, lines.tell, bag_keeper(session) if task.bags else no_bags)
    except RefusedError:
        return "not agreed"
    except KeyboardInterrupt:
        return STOPPED
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
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        write_event(END, guided(task, sys.stdin))
    except KeyboardInterrupt:
        write_event(END, STOPPED)
    except UsageError as error:
        write_event(END, str(error))


if __name__ == "__main__":
    main()
