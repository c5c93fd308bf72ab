"""What every process of ours does before ROS starts: stay on this machine, and be secure where that is asked for."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from pidtsm_ros.middleware import set_defaults

ENCLAVES = "/pidtsm"
"""Enclave under which each executable has its own, as in ``security/policies/pidtsm.policy.xml``."""

_CURE = "see docs/security.md, or unset ROS_SECURITY_ENABLE"


class SecurityError(RuntimeError):
    """Security was asked for and cannot be had; the message says why and what to do."""


def prepare_process(arguments: Sequence[str] | None = None) -> list[str]:
    """Prepare the environment of this process, and return its arguments for ``rclpy.init``.

    Discovery is limited to this machine, unless ``ROS_AUTOMATIC_DISCOVERY_RANGE`` says otherwise. With
    ``ROS_SECURITY_ENABLE=true`` the process gets the enclave ``/pidtsm/EXECUTABLE``, unless the arguments name one.

    Args:
        arguments: command line, the program first; the process's own where None.

    Raises:
        SecurityError: security is asked for and cannot be had.
    """
    words = list(sys.argv if arguments is None else arguments)
    set_defaults()
    if not security_requested():
        return words
    flags = [word for word in words if word in ("--enclave", "-e")]
    if flags:
        enclave = "".join(words[words.index(flags[0]) + 1 :][:1])
    else:
        enclave = f"{ENCLAVES}/{Path(sys.argv[0]).name}"
        words += ["--ros-args", "--enclave", enclave]
    require_security(enclave)
    return words


def security_requested() -> bool:
    """Whether ``ROS_SECURITY_ENABLE`` asks for security.

    Raises:
        SecurityError: it is neither true nor false. ROS takes anything but ``true`` for a no, which is not what
            somebody means who writes 1 or True.
    """
    asked = os.environ.get("ROS_SECURITY_ENABLE", "")
    if asked not in ("", "true", "false"):
        raise SecurityError(f"ROS_SECURITY_ENABLE is {asked!r}; ROS knows true and false, in small letters")
    return asked == "true"


def require_security(enclave: str) -> None:
    """See that a node in this enclave would be secure, and that nodes of this process are, or do not start.

    Raises:
        SecurityError: no keystore, no such enclave, or a middleware that cannot.
    """
    # ROS's own default is to go on without security where something is missing.
    os.environ["ROS_SECURITY_STRATEGY"] = "Enforce"
    keystore = os.environ.get("ROS_SECURITY_KEYSTORE")
    if not keystore:
        raise SecurityError(f"ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore; {_CURE}")
    enclave = os.environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE") or enclave
    folder = Path(keystore, "enclaves", enclave.lstrip("/"))
    if not folder.is_dir():
        raise SecurityError(f"ROS_SECURITY_ENABLE is true, but enclave {enclave} is missing: no {folder}; {_CURE}")
    _try_middleware(enclave)


def _try_middleware(enclave: str) -> None:
    """Make a node and let go of it: only that shows whether the middleware has security and takes the enclave."""
    context = Context()
    rclpy.init(
        args=["security_check", "--ros-args", "--enclave", enclave],
        context=context,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        Node(
            "security_check",
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        ).destroy_node()
    except Exception as error:
        reason = " ".join(str(error).split())
        middleware = rclpy.get_rmw_implementation_identifier()
        raise SecurityError(
            f"ROS_SECURITY_ENABLE is true, but {middleware} starts no secure node: {reason}; {_CURE}"
        ) from None
    finally:
        context.try_shutdown()
