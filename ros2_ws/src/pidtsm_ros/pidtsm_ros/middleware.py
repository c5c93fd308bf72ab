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
_UDP = "UDPv4"
_FAST_DDS = (None, "", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")  # It is the default.


def set_defaults(profiles: str = "fastdds.xml") -> None:
    """To be called before ROS starts; what is set stays as it is.

    Args:
        profiles: a file beside this one.
    """
    os.environ.setdefault(_PROFILES, str(Path(__file__).with_name(profiles)))
    # UDP instead of shared memory. Where discovery is limited to this machine ROS chooses by itself, and only the
    # profile has a say.
    os.environ.setdefault(_TRANSPORTS, _UDP)


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
        return {**limited, _RANGE: "LOCALHOST"}
    # With a range of its own choice, ROS adds transports that listen on every interface.
    return {**limited, _RANGE: "SYSTEM_DEFAULT", _PROFILES: str(bound)}
