"""Publishers of one topic are named as soon as the middleware knows their nodes."""

import pytest
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pidtsm_ros.sole_topic import known, named


def _of(name: str, namespace: str) -> TopicEndpointInfo:
    return TopicEndpointInfo(node_name=name, node_namespace=namespace)


@pytest.mark.parametrize(
    ("nodes", "names", "all_known"),
    [
        ([("trajectory", "/"), ("controller", "/left"), ("trajectory", "/")], "/left/controller, /trajectory", True),
        # What rmw reports between the discovery of a publisher and that of its node.
        (
            [("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_"), ("trajectory", "/")],
            "/trajectory, a node of unknown name",
            False,
        ),
        ([("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")], "a node of unknown name", False),
    ],
)
def test_nodes_are_named(nodes: list[tuple[str, str]], names: str, all_known: bool) -> None:
    publishers = [_of(*node) for node in nodes]
    assert named(publishers) == names
    assert known(publishers) == all_known
