"""``ros2 run pidtsm_experiments live``: the page of a system that runs already, simulated or real."""

import argparse
import asyncio
import errno
import os
import secrets
import sys
import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import rclpy
import rich
from viser import ViserServer

from pidtsm_core.errors import UsageError
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.gate import Gate, hidden_address
from pidtsm_experiments.live.nodes import Nodes
from pidtsm_experiments.live.options import HERE, add_page_arguments
from pidtsm_experiments.live.page import Page
from pidtsm_experiments.live.recording import Recording
from pidtsm_experiments.live.system import System
from pidtsm_ros.startup import start_ros
from pidtsm_ros.stop import Stop

FOLDER = Path("results", "live")
"""For bags and saved gains."""
_ROS_ARGUMENTS = "--ros-args"


def serve(options: argparse.Namespace, stop: Stop, nodes: Nodes | None, scenario: str, namespace: str | None) -> None:
    """Show the system until a stop is requested; ROS has been initialised.

    Args:
        options: of `add_page_arguments`.
        stop: ends the page.
        nodes: the processes, if they are this program's.
        scenario: name of the experiment.
        namespace: of the system; None: that of the command line.

    Raises:
        UsageError: the address cannot be used.
    """
    with ExitStack() as stack:
        system = System(namespace)
        stack.callback(system.close)
        recording = Recording(FOLDER.absolute(), system.namespace)
        stack.callback(recording.close)
        asyncio.run(_serve(options, stop, system, nodes, recording, scenario))


async def _serve(
    options: argparse.Namespace, stop: Stop, system: System, nodes: Nodes | None, recording: Recording, scenario: str
) -> None:
    rich.reconfigure(quiet=True)  # viser prints through it; an address that is not that of the page.
    hidden = hidden_address()
    with ExitStack() as stack:
        server = ViserServer(hidden, 0, "pidtsm", verbose=False)
        stack.callback(server.stop)
        desk = Desk(server, system, nodes, FOLDER.absolute(), scenario, asyncio.get_running_loop())
        token = "" if options.host in (HERE, "localhost") else secrets.token_urlsafe(16)
        listening = await _listen(Gate(hidden, server.get_port(), token, desk.offered), options.host, options.port)
        stack.callback(listening.close)
        address = f"http://{options.host if token else HERE}:{options.port}/{token and token + '/'}"
        print(f"live page: {address}", flush=True)
        if not token and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            webbrowser.open(address)
        await Page(desk, recording).run(stop)


async def _listen(gate: Gate, host: str, port: int) -> asyncio.Server:
    try:
        return await gate.listen(host, port)
    except OSError as error:
        reason = "is in use; choose another port" if error.errno == errno.EADDRINUSE else error.strerror
        raise UsageError(f"--host {host} --port {port}: {reason}") from None


def run(stop: Stop) -> int:
    """``ros2 run pidtsm_experiments live``; returns the exit code.

    Raises:
        SystemExit: ROS cannot start, see `refuse`; or invalid arguments.
    """
    words = sys.argv[1:]
    own, ros = _split(words)
    parser = argparse.ArgumentParser(description="The page of a system that runs already, simulated or real.")
    add_page_arguments(parser)
    options = parser.parse_args(own)
    start_ros(stop, [sys.argv[0], *ros])
    try:
        serve(options, stop, None, "live", None)
    except UsageError as error:
        print(f"live: {error}", file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
        stop.finish()
    return 0


def _split(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Own arguments and those of ROS."""
    place = words.index(_ROS_ARGUMENTS) if _ROS_ARGUMENTS in words else len(words)
    return list(words[:place]), list(words[place:])
