"""The process that moves and holds a real arm: sessions ask it over a socket, and it outlives them.

    python -m pidtsm_experiments.commissioning.holder SOCKET CONFIGURATION

While nobody asks for anything, it holds the arm where it is. Only a request to release the arm, or SIGTERM, ends it:
then commands cease, and brakes must carry the arm.
"""

import contextlib
import json
import queue
import shutil
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.robots import find_robot
from pidtsm_experiments.commissioning.port import RosPort
from pidtsm_studies.commissioning.arm import CommissionError, StoppedError, Wired, Wiring
from pidtsm_studies.commissioning.loop import Loop
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.motions import Motion
from pidtsm_studies.commissioning.signs import find_signs

DONE, TOLD, STOPPED, FAILED = "done", "told", "stopped", "failed"
"""Kinds of answers."""
SIGNS, FOLLOW, PERIOD, HOLD, RELEASE = "signs", "follow", "period", "hold", "release"
"""Kinds of requests."""


class _EndedError(CommissionError):
    """Who asked wants the arm to hold, or is gone."""


class _ReleasedError(Exception):
    """The arm is to be released."""


class Holder:
    """Holds an arm, and serves one session after the other."""

    def __init__(self, listener: Listener, arm: dict[str, Any], namespace: str, words: list[str]) -> None:
        self._sessions: queue.Queue[Connection] = queue.Queue()
        self._session: Connection | None = None
        self._arm, self._moves = arm, False
        joints = find_robot(arm).joints
        self._port = RosPort(joints, namespace, words, self._asked)
        self._loop = Loop(Wired(self._port, Wiring.described(len(joints))))
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def _accept(self, listener: Listener) -> None:
        while True:
            with contextlib.suppress(OSError, EOFError):
                self._sessions.put(listener.accept())

    def _asked(self) -> None:
        """Look whether the session wants the motion to end, or is gone.

        Raises:
            _EndedError: it does, or is; its motion comes to rest, because the arm is then held.
        """
        if not self._moves:
            return
        session = self._session
        try:
            if session is None or not self._sessions.empty():
                raise EOFError
            if session.poll() and session.recv()[0] == HOLD:
                raise _EndedError("interrupted")
        except (EOFError, OSError):
            self._session = None
            raise _EndedError("the session has ended") from None

    def run(self) -> None:
        """Hold the arm and serve sessions, until somebody releases the arm."""
        try:
            while True:
                try:
                    self._loop.hold()
                except CommissionError as error:  # Joint states may return.
                    print(error, flush=True)
                if (request := self._request()) is not None:
                    self._serve(*request)
        except _ReleasedError:
            self._answer(DONE, None)
        finally:
            self._port.close()

    def _request(self) -> tuple[Any, ...] | None:
        """The next request; None: there is none."""
        with contextlib.suppress(queue.Empty):
            self._session = self._sessions.get_nowait()
        try:
            if self._session is not None and self._session.poll():
                return tuple(self._session.recv())
        except Exception:  # The session is gone, or sends what is no request; the arm is held all the same.
            self._session = None
        return None

    def _serve(self, kind: str, *arguments: Any) -> None:
        requests: dict[str, Callable[..., Any]] = {
            SIGNS: self._signs,
            FOLLOW: self._follow,
            PERIOD: lambda: self._port.period,
            HOLD: lambda: None,
            RELEASE: self._release,
        }
        try:
            self._moves = kind in (SIGNS, FOLLOW)
            answer = requests[kind](*arguments)
        except _ReleasedError:
            raise
        except UsageError as error:
            self._moves = False
            self._answer(STOPPED if isinstance(error, StoppedError) else FAILED, str(error))
        except Exception as error:  # Whatever a step does wrong, the arm is held.
            self._moves = False
            traceback.print_exc()
            self._answer(FAILED, f"{type(error).__name__}: {error}; the arm is held, see the holder's log")
        else:
            self._moves = False
            self._answer(DONE, answer)

    def _answer(self, kind: str, content: Any) -> None:
        if self._session is not None:
            with contextlib.suppress(OSError):
                self._session.send((kind, content))

    def _signs(self) -> Any:
        signs, carry = find_signs(self._port, ArmModel(self._arm), lambda text: self._answer(TOLD, text))
        self._loop = Loop(Wired(self._port, signs.wiring), carry)
        return signs

    def _follow(self, settings: dict[str, Any], motion: Motion, wiring: Wiring) -> Any:
        if self._loop.carry is None and not self._loop.moved:
            self._loop = Loop(Wired(self._port, wiring))
        moves, self._moves = self._moves, False
        failed: list[Exception] = []

        def prepare() -> None:
            try:
                self._loop.prepare(settings)
            except Exception as error:  # It is raised below.
                failed.append(error)

        building = threading.Thread(target=prepare)
        building.start()
        while building.is_alive():  # The drives must not wait for a model to be read.
            self._loop.hold()
        if failed:
            raise failed[0]
        self._moves = moves
        return self._loop.follow(settings, motion, prepared=True)

    @staticmethod
    def _release() -> None:
        raise _ReleasedError


def main() -> None:
    """Run the process."""
    address, file = sys.argv[1:3]
    given = json.loads(Path(file).read_text(encoding="utf-8"))
    # Whoever interrupts a session at its terminal does not end what holds the arm.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    listener = Listener(address, "AF_UNIX")
    try:
        Holder(listener, given["arm"], given["namespace"], given["words"]).run()
    except CommissionError as error:
        with listener.accept() as session:
            session.send((FAILED, str(error)))
    finally:
        listener.close()
        shutil.rmtree(Path(address).parent, ignore_errors=True)


if __name__ == "__main__":
    main()
