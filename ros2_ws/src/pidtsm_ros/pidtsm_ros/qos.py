"""Quality of service of the topics.

Publishers are reliable and keep their last samples for readers that ask for them. The recorder does, so that it misses
nothing, also not what was said before discovery is through. In lockstep, where every sample is waited for, the other
readers are reliable too. In realtime they are not, since a sample that was missed is of no use later: to ask for it
would hold up those that follow, and a node that has not run for a moment would keep the loop busy with sending again.
All have some depth: a loop of depth one loses replies whenever a late process catches up.

Every node takes another quality for a topic as parameters, such as
``qos_overrides./joint_states.subscription.reliability:=reliable``.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)


def _profile(depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability)


PUBLISHER = _profile(4_000, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
"""In realtime. With every message, Fast DDS goes through all that a reader has received since the first one it lacks;
where more than a few seconds are kept, a reader that has missed them never catches up."""
LOCKSTEP_PUBLISHER = _profile(10_000, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
READER = _profile(100, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
"""In realtime; matches anybody's publishers, as it asks for the least."""
RELIABLE_READER = _profile(100, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""In lockstep, and of what is said once."""
RECORDER = _profile(20_000, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
KEPT = _profile(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
"""Of what is said when it changes: whoever comes later learns how it is."""
