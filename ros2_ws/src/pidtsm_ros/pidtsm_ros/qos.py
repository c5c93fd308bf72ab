"""Quality of service of the topics.

Publishers are reliable and keep their last samples for readers that have missed some. The recorder requests missed
samples and so receives everything from the moment a publisher has discovered it; the nodes delay their first messages
until then (``start.subscribers``). Durability is volatile: a late joiner receives only new messages, so the loop never
sends old ones. In lockstep, which waits for every sample, the other readers are reliable too. In realtime they are not:
a missed sample is useless later, requesting it would delay the following ones, and a node that was suspended for a
moment would keep the loop busy with resending. Every queue is deeper than one: a loop of depth one loses replies when a
late process catches up.

Parameters of every node override the quality of service of a topic, for example
``qos_overrides./joint_states.subscription.reliability:=reliable``.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)


def _profile(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=DurabilityPolicy.VOLATILE
    )


PUBLISHER = _profile(4_000, ReliabilityPolicy.RELIABLE)
"""In realtime. For every message, Fast DDS goes through all samples that a reader has received after the first one it
lacks. If more than a few seconds were kept, a reader that has missed them would never catch up."""
LOCKSTEP_PUBLISHER = _profile(10_000, ReliabilityPolicy.RELIABLE)
READER = _profile(100, ReliabilityPolicy.BEST_EFFORT)
"""In realtime; compatible with every publisher, since it requires the least."""
RELIABLE_READER = _profile(100, ReliabilityPolicy.RELIABLE)
"""In lockstep, and for topics whose messages are published once."""
RECORDER = _profile(20_000, ReliabilityPolicy.RELIABLE)
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For values that are published when they change: late joiners receive the current value."""
