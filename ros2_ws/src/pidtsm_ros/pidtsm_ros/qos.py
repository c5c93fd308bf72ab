"""Quality of service of the topics.

Publishers are reliable and keep their last samples for readers that have missed some. The recorder asks for those, so
that it has everything from the moment on when a publisher knows of it; the nodes' first messages wait for that
(``start.subscribers``). Durability is volatile: who joins later gets what is said from then on, and the loop sends
nobody its past. In lockstep, where every sample is waited for, the other readers are reliable too. In realtime they are
not, since a sample that was missed is of no use later: to ask for it would hold up those that follow, and a node that
has not run for a moment would keep the loop busy with sending again. All have some depth: a loop of depth one loses
replies whenever a late process catches up.

Every node takes another quality for a topic as parameters, such as
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
"""In realtime. With every message, Fast DDS goes through all that a reader has received since the first one it lacks;
where more than a few seconds are kept, a reader that has missed them never catches up."""
LOCKSTEP_PUBLISHER = _profile(10_000, ReliabilityPolicy.RELIABLE)
READER = _profile(100, ReliabilityPolicy.BEST_EFFORT)
"""In realtime; matches anybody's publishers, as it asks for the least."""
RELIABLE_READER = _profile(100, ReliabilityPolicy.RELIABLE)
"""In lockstep, and of what is said once."""
RECORDER = _profile(20_000, ReliabilityPolicy.RELIABLE)
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of what is said when it changes: whoever comes later learns how it is."""
