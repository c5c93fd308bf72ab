"""A constant effort that the controller compensates makes no difference, whatever the controller does."""

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Mode, Status

LIFT = """
<robot name="lift">
  <link name="base"/>
  <link name="car">
    <inertial><mass value="10"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="car"/><axis xyz="0 0 1"/>
    <limit lower="-0.5" upper="0.5" effort="300" velocity="1"/>
  </joint>
</robot>"""
FAULT = {"limits.velocity": 0.02, "limits.velocity_action": "stop"}
DOES: dict[str, tuple[Mode, dict[str, object]]] = {
    "follows": (Mode.FOLLOWING, {}),
    "holds": (Mode.HOLDING, {"rehearsal.hold": 0.5}),
    "is guided": (Mode.FREEDRIVE, {"rehearsal.freedrive": 0.5}),
    "stops": (Mode.STOPPED, FAULT),
    "stops without holding": (Mode.STOPPED, {**FAULT, "stop.effort": "gravity_damping"}),
}


def lifted(offset: float, **controller: object) -> Recording:
    return rollout(
        robot=LIFT, params="practical", duration=1.5, simulator={"friction.offset": offset}, controller=controller
    )


@pytest.mark.parametrize("does", DOES)
def test_a_compensated_offset_changes_nothing_but_the_effort(does: str) -> None:
    mode, controller = DOES[does]
    without = lifted(0.0, **controller)
    with_offset = lifted(23.0, **controller, **{"compensation.offset": 23.0})
    assert without.status[-1, Status.MODE] == with_offset.status[-1, Status.MODE] == mode
    np.testing.assert_allclose(with_offset.position, without.position, atol=1e-5)
    np.testing.assert_allclose(with_offset.effort[1:] - without.effort[1:], 23.0, atol=0.2)


def test_an_offset_that_is_not_compensated_pulls_the_arm_away() -> None:
    assert np.abs(lifted(23.0).error).max() > 100.0 * np.abs(lifted(23.0, **{"compensation.offset": 23.0}).error).max()
