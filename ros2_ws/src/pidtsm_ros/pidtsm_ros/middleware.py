"""Settings of Fast DDS that serve our nodes; a user's own come first, and other middlewares do not look."""

import os
from pathlib import Path

RECEIVERS = "dds.udp."
"""How the names of Fast DDS's threads begin that take messages in."""


def set_defaults(profiles: str = "fastdds.xml") -> None:
    """To be called before ROS starts; what is set stays as it is.

    Args:
        profiles: a file beside this one.
    """
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).with_name(profiles)))
    # UDP instead of shared memory. Where discovery is limited to this machine ROS chooses by itself, and only the
    # profile has a say.
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
