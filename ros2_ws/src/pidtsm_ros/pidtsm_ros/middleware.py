"""Settings of Fast DDS that serve our nodes; a user's own come first, and other middlewares do not look."""

import os
from collections.abc import Mapping
from pathlib import Path

RECEIVERS = "dds.udp."
"""How the names of Fast DDS's threads begin that take messages in."""
_PROFILES, _TRANSPORTS, _RANGE = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
)
_WIDER = ("ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")
"""Peers on other machines, and what would overrule the range, though it is out of date."""
_UDP, _LOCAL = "UDPv4", "LOCALHOST"
_FAST_DDS = (None, "", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")  # It is the default.


def set_defaults(profiles: str = "fastdds.xml") -> None:
    """Set the environment of this process, before ROS starts; what the user has set stays as it is.

    Discovery is limited to this machine where nobody has chosen a range, and then, or where the user has limited it,
    sockets are bound to this machine too.

    Args:
        profiles: a file beside this one.
    """
    os.environ.setdefault(_PROFILES, str(Path(__file__).with_name(profiles)))
    # UDP instead of shared memory: to open the memory of a process that has just joined, Fast DDS waits for a third of
    # a second, and everything in this process waits with it.
    os.environ.setdefault(_TRANSPORTS, _UDP)
    if os.environ.setdefault(_RANGE, _LOCAL) == _LOCAL and not any(name in os.environ for name in _WIDER):
        # ROS, where it limits discovery itself, adds shared memory whatever the transports are said to be.
        os.environ.update(on_this_machine(os.environ, profiles))


def on_this_machine(environment: Mapping[str, str], profiles: str = "fastdds.xml") -> dict[str, str]:
    """The environment of a process that is for this machine alone.

    With Fast DDS its sockets are bound to 127.0.0.1. Where the environment names profiles or transports, and with
    another middleware, discovery alone is limited.

    Args:
        environment: to begin with.
        profiles: what the process gives to `set_defaults`.
    """
    limited = {name: value for name, value in environment.items() if name not in _WIDER}
    bound = Path(__file__).with_name(profiles.replace(".xml", "_loopback.xml"))
    chosen = environment.get(_PROFILES), environment.get(_TRANSPORTS), environment.get("RMW_IMPLEMENTATION")
    ours = not chosen[0] or Path(chosen[0]).parent == bound.parent
    if not (ours and chosen[1] in (None, "", _UDP) and chosen[2] in _FAST_DDS):
        return {**limited, _RANGE: _LOCAL}
    # Where ROS limits discovery itself, it adds transports that listen on every interface.
    return {**limited, _RANGE: "SYSTEM_DEFAULT", _PROFILES: str(bound)}
