"""A commissioning as a page guides it: its session runs in a process of its own, see `commissioning.guided`."""

import asyncio
import json
import signal
import sys
import time
from asyncio.subprocess import PIPE, Process
from collections import deque
from contextlib import suppress
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commissioning.guided import AGREED, END, FINDING, PLAN, Asked, Task
from pidtsm_experiments.commissioning.remote import is_held, release
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_studies.commissioning.session import Session, Subject

_MODULE = "pidtsm_experiments.commissioning.guided"
_SAID = 12
"""Findings that are remembered."""
_LONGEST = 1 << 20
"""Bytes of a line."""


class Guide:
    """At most one session at a time.

    Attributes:
        session: the one that is guided, or was last; None: there is none.
        asked: the step that waits for an answer, or runs; None: none.
        since: when the step was agreed to, of `time.monotonic`; None: it waits for an answer.
        said: what was found, the newest last.
        ended: why the session has ended before its last step; empty: it has not.
        alone: whether all steps that follow are agreed to.
    """

    def __init__(self) -> None:
        self.session: Session | None = None
        self.asked: Asked | None = None
        self.since: float | None = None
        self.said: deque[str] = deque(maxlen=_SAID)
        self.ended = ""
        self.alone = False
        self._process: Process | None = None
        self._hearing: asyncio.Task[None] | None = None

    @property
    def runs(self) -> bool:
        """Whether a session runs."""
        return self._process is not None

    @property
    def held(self) -> bool:
        """Whether a process holds the arm of the session."""
        return self.session is not None and is_held(self.session.folder)

    async def begin(self, task: Task, subject: Subject) -> None:
        """Begin a session, or go on with it.

        Args:
            task: the session.
            subject: what the task commissions.

        Raises:
            RefusedError: a session runs, or the folder has another one.
        """
        if self.runs:
            raise RefusedError("a session runs already")
        try:
            self.session = Session.opened(Path(task.folder), subject)
        except UsageError as error:
            raise RefusedError(str(error)) from None
        self.asked, self.since, self.ended, self.alone = None, None, "", False
        self.said.clear()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # The process inherits this, and unblocks it later.
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", _MODULE, stdin=PIPE, stdout=PIPE, limit=_LONGEST
            )
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        self._write(task.line())
        self._hearing = asyncio.ensure_future(self._hear(self._process, subject))

    def _write(self, line: str) -> None:
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.write(f"{line}\n".encode())

    async def _hear(self, process: Process, subject: Subject) -> None:
        """Take the events of the session until it has ended."""
        assert process.stdout is not None
        assert self.session is not None
        folder, ended = self.session.folder, "its process has ended unexpectedly"
        async for line in process.stdout:
            try:
                kind, content = json.loads(line)
            except ValueError:  # What a library prints.
                continue
            if kind == END:
                ended = str(content)
            elif kind == PLAN:
                self.session = Session.opened(folder, subject)
                self.asked, self.since = Asked(**content), None
                if self.alone:
                    self.agree()
            elif kind == FINDING:
                self.said.append(str(content))
        await process.wait()
        self.session = Session.opened(folder, subject)
        self.asked, self.since, self._process, self.ended = None, None, None, ended

    def agree(self) -> None:
        """Let the step begin that waits for an answer.

        Raises:
            RefusedError: none waits.
        """
        if self.asked is None or self.since is not None:
            raise RefusedError("no step waits for an answer")
        self.since = time.monotonic()
        self._write(AGREED)

    async def stop(self) -> None:
        """End the session; the arm comes to rest, and is held.

        Raises:
            RefusedError: none runs.
        """
        if self._process is None:
            raise RefusedError("no session runs")
        self.alone = False
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGINT)
        if self._hearing is not None:
            await self._hearing

    async def release(self) -> None:
        """End what holds the arm: commands cease.

        Raises:
            RefusedError: a session runs, or nothing holds the arm.
        """
        if self.runs:
            raise RefusedError("a session runs; stop it first")
        if self.session is None or not await asyncio.to_thread(release, self.session.folder):
            raise RefusedError("nothing holds the arm")
