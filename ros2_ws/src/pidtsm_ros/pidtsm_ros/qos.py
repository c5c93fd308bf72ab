"""Quality of service of the topics.

Publishers are reliable and keep their last samples for readers that ask for them (the recorder does, so that it misses
nothing, also not what was said before discovery is through). Other readers ask for less, so that they match anybody's
publishers. All have some depth: a loop of depth one loses replies whenever a late process catches up.

Every node takes another quality for a topic as parameters, such as
``qos_overrides./joint_states.subscription.reliability:=best_effort``.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)

PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10_000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""For samples in realtime. A sample that was missed is of no use later: to ask for it would hold up those that follow,
and whoever has not run for a moment would keep the publisher, which is the loop itself, sending again."""
READER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""For samples in lockstep, each of which is waited for, and for what is said once."""
RECORDER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=20_000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
