"""What the middleware does for a sample that did not arrive."""

import pytest
from bench import Bench
from rclpy.qos import ReliabilityPolicy

SAMPLES = {"joint_states": 2, "reference": 1, "joint_commands": 1}
"""Topics of the loop, and how many of our nodes listen."""


@pytest.mark.parametrize(
    ("simulator", "controller", "trajectory", "expected"),
    [
        ("clock:=realtime", "reference.match:=latest", "clock:=realtime", ReliabilityPolicy.BEST_EFFORT),
        ("clock:=lockstep", "reference.match:=stamp", "clock:=lockstep", ReliabilityPolicy.RELIABLE),
    ],
)
def test_samples_are_asked_for_again_in_lockstep_alone(
    bench: Bench, simulator: str, controller: str, trajectory: str, expected: ReliabilityPolicy
) -> None:
    """In realtime a node that has not run for a moment would keep the loop sending what nobody needs any more."""
    bench.start("simulator", simulator)
    bench.start("controller", controller)
    bench.start("trajectory", trajectory)
    for topic, listening in {**SAMPLES, "joint_trajectory": 1}.items():
        bench.spin_until(lambda t=topic, n=listening: bench.node.count_subscribers(t) == n, f"readers of {topic}")
        readers = bench.node.get_subscriptions_info_by_topic(topic)
        wanted = expected if topic in SAMPLES else ReliabilityPolicy.RELIABLE
        assert {reader.qos_profile.reliability for reader in readers} == {wanted}, topic
