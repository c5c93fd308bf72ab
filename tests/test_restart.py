"""A controller that dies under way is replaced, and the new one takes the arm over without a jolt."""

import numpy as np
from bench import Bench
from sensor_msgs.msg import JointState

from pidtsm_core.parameters import Array
from pidtsm_core.robots.two_link import TWO_LINK
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.stamps import nanoseconds

STEP = 10.0  # N m
CLOSE = 0.02  # rad


def gravity(position: Array) -> Array:
    values = {f"robot.{p.name}": p.default for p in TWO_LINK.parameters}
    effort = np.zeros((1, 2))
    TWO_LINK.inverse_dynamics(position, np.zeros(2), np.zeros((1, 2)), TWO_LINK.pack_model(values), effort)
    return effort[0]


def test_tracking_resumes_within_a_second_and_without_a_step_of_torque(bench: Bench) -> None:
    states: list[ControllerState] = []
    truths: list[JointState] = []
    bench.node.create_subscription(ControllerState, "controller/state", states.append, 1000)
    bench.node.create_subscription(JointState, "simulator/ground_truth", truths.append, 1000)
    for node in ("trajectory", "simulator"):
        bench.start(node)

    def follows() -> bool:
        return bool(states and truths) and max(map(abs, states[-1].position_error)) < CLOSE

    # A machine that stalls for a moment is no fault here.
    patient = "watchdog.state_stop:=1.0"
    first = bench.start("controller", patient)
    bench.spin_until(follows, "the reference is followed")
    first.process.kill()
    first.wait()
    died = nanoseconds(truths[-1].header.stamp)
    bench.spin_until(lambda: nanoseconds(truths[-1].header.stamp) > died + 1e9, "a second without a controller")
    states.clear()
    del bench.processes.running["controller"]
    bench.start("controller", patient)
    bench.spin_until(lambda: len(states) > 2000, "two seconds of the second controller")

    stamps = np.array([nanoseconds(state.header.stamp) for state in states]) / 1e9
    efforts = np.array([state.effort for state in states])
    desired = np.array([np.array(s.position) - np.array(s.position_error) for s in states])
    held = np.array(states[0].position)
    np.testing.assert_allclose(desired[0], held, atol=1e-9, err_msg="it begins where the arm is")
    assert np.abs(efforts[0] - gravity(held)).max() < STEP
    assert np.abs(np.diff(efforts, axis=0)).max() < STEP
    follows_from = np.argmax([state.mode == ControllerState.FOLLOWING for state in states])
    late = stamps > stamps[follows_from] + 1.0
    assert late.any()
    error = np.array([state.position_error for state in states])
    assert np.abs(error[late]).max() < CLOSE
