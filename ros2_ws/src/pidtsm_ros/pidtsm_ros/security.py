"""Preparation of every process before ROS starts: limit it to this machine and, if requested, enforce security."""

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
"""Parent of the executables' enclaves, as in ``security/policies/pidtsm.policy.xml``."""

_ADVICE = "see docs/security.md, or unset ROS_SECURITY_ENABLE"


class SecurityError(RuntimeError):
    """Security is requested but not available; the message contains the reason and a remedy."""


def prepare_process(arguments: Sequence[str] | None = None) -> list[str]:
    """Prepare the environment of this process, and return its arguments for ``rclpy.init``.

    Discovery is limited to this machine unless ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is set to another range. With
    ``ROS_SECURITY_ENABLE=true`` the process gets the enclave ``/pidtsm/EXECUTABLE``, unless the arguments name one.

    Args:
        arguments: command line, beginning with the program; None: that of the process.

    Raises:
        SecurityError: security is requested but not available.
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
    """Whether ``ROS_SECURITY_ENABLE`` requests security.

    Raises:
        SecurityError: it is neither true nor false. ROS disables security for any value but ``true``, which is not what
            a user who sets 1 or True intends.
    """
    requested = os.environ.get("ROS_SECURITY_ENABLE", "")
    if requested not in ("", "true", "false"):
        raise SecurityError(f"ROS_SECURITY_ENABLE is {requested!r}; it must be true or false, in lower case")
    return requested == "true"


def require_security(enclave: str) -> None:
    """Check that a node in this enclave is secure, and make this process start secure nodes only.

    Raises:
        SecurityError: no keystore, no such enclave, or a middleware without security.
    """
    # By default, ROS continues without security if something is missing.
    os.environ["ROS_SECURITY_STRATEGY"] = "Enforce"
    keystore = os.environ.get("ROS_SECURITY_KEYSTORE")
    if not keystore:
        raise SecurityError(f"ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore; {_ADVICE}")
    enclave = os.environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE") or enclave
    folder = Path(keystore, "enclaves", enclave.lstrip("/"))
    if not folder.is_dir():
        raise SecurityError(f"ROS_SECURITY_ENABLE is true, but enclave {enclave} is missing: no {folder}; {_ADVICE}")
    _try_middleware(enclave)


def _try_middleware(enclave: str) -> None:
    """Create and destroy a node, the only way to find out whether the middleware is secure and accepts the enclave."""
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
            f"ROS_SECURITY_ENABLE is true, but {middleware} cannot start a secure node: {reason}; {_ADVICE}"
        ) from None
    finally:
        context.try_shutdown()
