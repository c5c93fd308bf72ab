"""Default settings of Fast DDS for our nodes. The user's settings take precedence; other middlewares ignore them."""

import os
from collections.abc import Mapping
from pathlib import Path

RECEIVERS = "dds.udp."
"""Prefix of the names of Fast DDS's receiving threads."""
_PROFILES, _TRANSPORTS, _RANGE = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
)
_WIDER = ("ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")
"""Peers on other machines, and a deprecated variable that overrides the range."""
_UDP, _LOCAL = "UDPv4", "LOCALHOST"
_FAST_DDS = (None, "", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")  # the default middleware


def set_defaults(profiles: str = "fastdds.xml") -> None:
    """Set the environment of this process before ROS starts; variables set by the user are kept.

    If no discovery range is set, discovery is limited to this machine. If it is limited to this machine, by default or
    by the user, sockets are bound to this machine too.

    Args:
        profiles: name of a file in the folder of this module.
    """
    os.environ.setdefault(_PROFILES, str(Path(__file__).with_name(profiles)))
    # UDP instead of shared memory: Fast DDS takes a third of a second to open the memory of a process that has just
    # joined, and blocks this whole process meanwhile.
    os.environ.setdefault(_TRANSPORTS, _UDP)
    if os.environ.setdefault(_RANGE, _LOCAL) == _LOCAL and not any(name in os.environ for name in _WIDER):
        # If ROS limits discovery itself, it adds shared memory regardless of the chosen transports.
        os.environ.update(on_this_machine(os.environ, profiles))


def on_this_machine(environment: Mapping[str, str], profiles: str = "fastdds.xml") -> dict[str, str]:
    """Environment of a process that communicates on this machine only.

    With Fast DDS, its sockets are bound to 127.0.0.1. If the environment sets profiles or transports, or another
    middleware is used, only discovery is limited.

    Args:
        environment: the environment to start from.
        profiles: the file that the process passes to `set_defaults`.
    """
    limited = {name: value for name, value in environment.items() if name not in _WIDER}
    bound = Path(__file__).with_name(profiles.replace(".xml", "_loopback.xml"))
    chosen = environment.get(_PROFILES), environment.get(_TRANSPORTS), environment.get("RMW_IMPLEMENTATION")
    ours = not chosen[0] or Path(chosen[0]).parent == bound.parent
    if not (ours and chosen[1] in (None, "", _UDP) and chosen[2] in _FAST_DDS):
        return {**limited, _RANGE: _LOCAL}
    # If ROS limits discovery itself, it adds transports that listen on every interface.
    return {**limited, _RANGE: "SYSTEM_DEFAULT", _PROFILES: str(bound)}
