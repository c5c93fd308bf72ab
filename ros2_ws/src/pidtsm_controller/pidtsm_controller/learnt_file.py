"""The file in which a controller node keeps what it has learnt about its arm."""

import json
import os
from pathlib import Path
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger

from pidtsm_core.control import Controller
from pidtsm_core.control.learnt import LearntError, learnt, recall


class LearntFile:
    """Reads what was learnt at the activation of a node, and writes it at its deactivation."""

    def __init__(self, path: str, controller: Controller, joints: tuple[str, ...], logger: RcutilsLogger) -> None:
        """Args: path: of the file; ``~`` is the user's home. controller, joints: of the node. logger: likewise."""
        self._path = Path(path).expanduser()
        self._controller, self._joints, self._logger = controller, joints, logger

    def read(self) -> None:
        """Go on from the file, if there is one; what cannot be used is logged, and the controller begins anew."""
        try:
            content: Any = json.loads(self._path.read_text(encoding="utf-8"))
            recall(self._controller.config, self._controller.state, self._joints, content)
        except FileNotFoundError:
            return
        except (OSError, ValueError, RecursionError, LearntError) as reason:
            self._logger.warning(f"adaptation.file: {self._path} is not used, and the controller begins anew: {reason}")
            return
        self._logger.info(f"adaptation.file: continuing from {self._path}")

    def write(self) -> None:
        """Replace the file by a whole new one."""
        content = learnt(self._controller.config, self._controller.state, self._joints)
        new = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            new.write_text(json.dumps(content, allow_nan=False), encoding="utf-8")
            new.replace(self._path)
        except (OSError, ValueError) as reason:
            new.unlink(missing_ok=True)
            self._logger.warning(f"adaptation.file: {self._path} is not written: {reason}")
