"""Joins the user's ROS domain for the time of a command."""

import asyncio
import os
import time
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace

from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.system import System
from pidtsm_ros.security import SecurityError, prepare_process

FOUND_WITHIN = 5.0
"""s; discovery takes half a second, with profiles other than ours up to 3."""
_NAME = "pidtsm_nodes"
_POLL = 0.02  # s
_START = "start one with ./pidtsm nodes start, or name the domain with ROS_DOMAIN_ID and the namespace with --namespace"
_Answer = TypeVar("_Answer")


def ros_domain() -> str:
    """The user's ROS domain."""
    return os.environ.get("ROS_DOMAIN_ID") or "0"


def place(namespace: str) -> str:
    """Where nodes are looked for, as the end of a sentence; `namespace`: with or without its slash."""
    inner = namespace.strip("/")
    return f"in ROS domain {ros_domain()}" + (f", namespace /{inner}" if inner else "")


@contextmanager
def joined(namespace: str, words: Sequence[str] = ()) -> Iterator[System]:
    """A system in the user's domain; SIGINT and SIGTERM are handled as before.

    Args:
        namespace: of its nodes.
        words: arguments of ROS, such as ``-r joint_states:=/arm/joint_states``.

    Raises:
        UsageError: domain, namespace or an argument is invalid, or security is requested but not available.
    """
    try:
        validate_namespace(f"/{namespace.lstrip('/')}")
    except InvalidNamespaceException as error:  # Its text has a drawing of the place.
        raise UsageError(f"--namespace {namespace}: {str(error).splitlines()[0].rstrip(':')}") from None
    try:
        arguments = ["pidtsm", *(["--ros-args", *words] if words else [])]
        rclpy.init(args=prepare_process(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except SecurityError as error:
        raise UsageError(str(error)) from None
    except Exception as error:  # rcl refuses arguments and domains with errors of many types.
        raise UsageError(f"cannot join ROS domain {ros_domain()}: {' '.join(str(error).split())}") from None
    try:
        system = System(namespace, _NAME)
        try:
            yield system
        finally:
            system.close()
    finally:
        rclpy.try_shutdown()


def run(system: System, request: Coroutine[Any, Any, _Answer]) -> _Answer:
    """The answer of a coroutine, while the system is spun.

    Raises:
        RunError: a node refuses, in its words.
    """

    async def answered() -> _Answer:
        spinning = asyncio.ensure_future(_spin(system))
        try:
            return await request
        finally:
            spinning.cancel()
            with suppress(asyncio.CancelledError):
                await spinning

    try:
        return asyncio.run(answered())
    except RefusedError as error:
        raise RunError(str(error)) from None


async def _spin(system: System) -> None:
    while True:
        system.spin()
        await asyncio.sleep(_POLL)


async def found(system: System, node: str, within: float = FOUND_WITHIN) -> None:
    """Wait for a node of the system.

    Raises:
        RunError: it does not come in time.
    """
    end = time.monotonic() + within
    while not system.has(node):
        if time.monotonic() > end:
            kind = "controller" if node == "controller" else f"node {node}"
            others = sorted(space for name, space in system.graph() if name == node)
            cure = f"there is one in namespace {others[0]}: --namespace {others[0].strip('/')}" if others else _START
            raise RunError(f"no pidtsm {kind} {place(system.namespace)}; {cure}")
        await asyncio.sleep(_POLL)
