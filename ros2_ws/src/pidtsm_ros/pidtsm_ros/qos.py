"""Quality of service of the topics.

Reliable with some depth: a best-effort, depth-one loop loses replies whenever a late process catches up.
Publishers keep their last samples for late readers that ask for them (the recorder does, so that it misses
nothing before discovery is through); readers ask for the least, so that they match anybody's publishers.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
READER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
RECORDER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=20_000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
