"""A weak drive behind a torque sensor that does not see the friction of its gear."""

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.detectors.saturated import saturation
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.observed import Observed

_TIME: Array = np.linspace(0.0, 10.0, 5001)
_FRICTION = 3.0


def _observed(command: Array, velocity: Array, drive: float) -> Loop:
    """A joint whose sensor sees what its drive delivers, without friction."""
    delivered = np.clip(command, -drive, drive)
    effort = delivered - _FRICTION * np.tanh(velocity / 0.01)
    position = 0.002 * np.cumsum(velocity)
    reference, measured, torque, wanted = (each[:, np.newaxis] for each in (position, position, effort, command))
    return Loop(Observed(("joint",), _TIME, measured, torque, wanted, reference))


@pytest.mark.parametrize(("drive", "saturates"), [(100.0, False), (12.0, True)])
def test_a_joint_that_its_load_drives_back_lacks_effort(drive: float, saturates: bool) -> None:
    command = 15.0 + 25.0 * np.clip(np.sin(2.0 * np.pi * 0.1 * _TIME), 0.0, None)
    velocity = 0.2 * np.cos(2.0 * np.pi * 0.1 * _TIME)
    verdict = saturation(_observed(command, velocity, drive), None)
    assert verdict.found == saturates, verdict.text


def test_a_joint_that_always_stays_at_what_its_drive_delivers_lacks_effort() -> None:
    command, velocity = np.full_like(_TIME, 40.0), np.full_like(_TIME, -0.05)
    assert saturation(_observed(command, velocity, 12.0), None).found


def test_a_joint_that_bears_no_load_lacks_nothing() -> None:
    nothing = np.zeros_like(_TIME)
    assert not saturation(_observed(nothing, nothing, 12.0), None).found
