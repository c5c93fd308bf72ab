"""The arm that a holder holds, for a session: starts the holder, or finds the one that an earlier session has left."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Client, Connection
from pathlib import Path
from types import TracebackType
from typing import Any

from pidtsm_experiments.commissioning.holder import DONE, FOLLOW, HOLD, PERIOD, RELEASE, SIGNS, STOPPED, TOLD
from pidtsm_experiments.errors import RunError
from pidtsm_studies.commissioning.arm import CommissionError, StoppedError, Wiring
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion
from pidtsm_studies.commissioning.signs import Signs

_HOLDER, _CONFIGURATION, _LOG = "holder.json", "holder-arm.json", "holder.log"
"""Names in the folder of a session."""
_STARTED_WITHIN = 30.0
"""s until the holder answers."""
_POLL = 0.1  # s
_MODULE = "pidtsm_experiments.commissioning.holder"


class RemoteArm:
    """See `session.Source`; a context manager that leaves the arm held."""

    def __init__(
        self,
        folder: Path,
        arm: Mapping[str, Any],
        namespace: str = "",
        words: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Find the holder of a session's folder, or start one.

        Args:
            folder: of the session.
            arm: parameters of the controller that choose the arm.
            namespace: of the topics.
            words: arguments of ROS.
            environment: of the holder; None: that of this process.

        Raises:
            RunError: it does not start.
            CommissionError: it finds no arm.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._wiring = folder, Wiring.described(0)
        found = _found(folder)
        self._connection = found or self._started(arm, namespace, words, environment)
        self.was_held = found is not None
        self._period = float(self._ask(PERIOD))

    def _started(
        self, arm: Mapping[str, Any], namespace: str, words: Sequence[str], environment: Mapping[str, str] | None
    ) -> Connection:
        # A socket's path must be short; the folder is readable by this user only.
        address = str(Path(tempfile.mkdtemp(prefix="pidtsm-holder-")) / "socket")
        configuration = self._folder / _CONFIGURATION
        configuration.write_text(
            json.dumps({"arm": dict(arm), "namespace": namespace, "words": list(words)}, default=list),
            encoding="utf-8",
        )
        log = self._folder / _LOG
        with log.open("wb") as file:
            process = subprocess.Popen(
                [sys.executable, "-m", _MODULE, address, str(configuration)],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                env=dict(environment or os.environ),
                start_new_session=True,
            )
        (self._folder / _HOLDER).write_text(json.dumps({"address": address, "pid": process.pid}), encoding="utf-8")
        end = time.monotonic() + _STARTED_WITHIN
        while True:
            try:
                return Client(address, "AF_UNIX")
            except OSError:
                if process.poll() is not None or time.monotonic() > end:
                    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()[-5:]
                    raise RunError("\n".join([f"what holds the arm does not start; {log}:", *lines])) from None
                time.sleep(_POLL)

    def __enter__(self) -> "RemoteArm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._connection.close()

    @property
    def period(self) -> float:
        """See `Loop`."""
        return self._period

    def _ask(self, kind: str, *arguments: Any, tell: Callable[[str], None] = lambda _: None) -> Any:
        """The answer to a request; Ctrl-C meanwhile brings the arm to rest.

        Raises:
            CommissionError: the request failed, with its reason.
        """
        self._connection.send((kind, *arguments))
        try:
            while True:
                answer, content = self._connection.recv()
                if answer == TOLD:
                    tell(content)
                elif answer == DONE:
                    return content
                else:
                    raise (StoppedError if answer == STOPPED else CommissionError)(content)
        except KeyboardInterrupt:
            self._connection.send((HOLD,))
            raise
        except (EOFError, ConnectionError):
            raise CommissionError(f"what holds the arm has ended; see {self._folder / _LOG}") from None

    def signs(self, _arm: Mapping[str, Any], tell: Callable[[str], None]) -> Signs:
        """See `session.Source`; the holder knows the arm."""
        found: Signs = self._ask(SIGNS, tell=tell)
        return found

    def follower(self, _step: int, wiring: Wiring) -> "RemoteArm":
        """See `session.Source`; a real arm goes on from where it is, whatever the step."""
        self._wiring = wiring
        return self

    def follow(self, settings: Mapping[str, Any], motion: Motion) -> Samples:
        """See `Loop.follow`."""
        samples: Samples = self._ask(FOLLOW, dict(settings), motion, self._wiring)
        return samples

    def release(self) -> None:
        """End the holder: commands cease, and something else must carry the arm."""
        _end(self._connection, self._folder)


def _found(folder: Path) -> Connection | None:
    """The connection to a holder that an earlier session has left in its folder; None: there is none."""
    try:
        known = json.loads((folder / _HOLDER).read_text(encoding="utf-8"))
        # The folder may be somebody else's; what their process sends must not be unpacked here.
        if Path(known["address"]).stat().st_uid != os.getuid():
            return None
        return Client(known["address"], "AF_UNIX")
    except (OSError, ValueError, KeyError):
        return None


def is_held(folder: Path) -> bool:
    """Whether the holder of a session's folder runs; it is not disturbed."""
    try:
        known = json.loads((folder / _HOLDER).read_text(encoding="utf-8"))
        os.kill(int(known["pid"]), 0)
        return Path(known["address"]).exists()
    except (OSError, ValueError, KeyError):
        return False


def release(folder: Path) -> bool:
    """End the holder of a session's folder; returns whether there is one."""
    connection = _found(folder)
    if connection is None:
        return False
    with connection:
        _end(connection, folder)
    return True


def _end(connection: Connection, folder: Path) -> None:
    connection.send((RELEASE,))
    with contextlib.suppress(EOFError, ConnectionError):
        connection.recv()
    (folder / _HOLDER).unlink(missing_ok=True)
