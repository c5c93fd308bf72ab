"""Settings of Fast DDS that serve our nodes; a user's own come first, and other middlewares do not look."""

import os
from pathlib import Path

_DEFAULTS = {
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("fastdds.xml")),
    # For small messages UDP takes a tenth less time than shared memory (./pidtsm bench), and a reader that is killed
    # leaves no lock behind that a writer waits for.
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
}


def set_defaults() -> None:
    """To be called before ROS starts."""
    for name, value in _DEFAULTS.items():
        os.environ.setdefault(name, value)
