"""xacro: files that are expanded to a URDF by a process of their own, see `confined`."""

import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from pidtsm_core.robots import confined
from pidtsm_core.robots.errors import DescriptionError

_WITHIN = 6.0  # s


def expanded(file: Path, arguments: Mapping[str, str]) -> str:
    """The URDF that a xacro file expands to.

    Args:
        file: the file.
        arguments: values of its arguments (``xacro:arg``) by name; the others have their defaults.

    Raises:
        DescriptionError: an argument is unknown or has no value, xacro is not installed, the file cannot be expanded,
            takes too long, or takes too much memory, or this machine cannot confine the process.
    """
    if find_spec("xacro") is None:
        raise DescriptionError(f"{file} needs xacro: pip install xacro, or expand it to a URDF")
    words = [f"{name}:={value}" for name, value in arguments.items()]
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [sys.executable, str(Path(confined.__file__)), str(file), *words],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            code = process.wait(_WITHIN)
        except subprocess.TimeoutExpired:
            code = -signal.SIGXCPU
        finally:
            process.kill()
            process.wait()
        output.seek(0)
        text = output.read().decode(errors="replace")
    if code == 0:
        return text
    raise DescriptionError(f"{file}: {_reason(code, text)}")


def _reason(code: int, text: str) -> str:
    """Why a file was not expanded, from the exit code and the output of the process."""
    if code == confined.FAILED:
        return text.strip()
    if code == confined.UNCONFINED:
        return (
            f"this machine cannot confine xacro, whose files may contain programs ({text.strip()}); if you trust it, "
            "expand it yourself: xacro FILE > arm.urdf"
        )
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"expanding it takes longer than {confined.CPU} s"
    if len(text) >= confined.OUTPUT:
        return f"it expands to more than {confined.OUTPUT // 2**20} MB"
    return f"xacro ended with code {code}: {' '.join(text.split())[-200:]}"
