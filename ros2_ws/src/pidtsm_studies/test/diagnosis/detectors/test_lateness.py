"""How late a drive is, from commands and efforts that were made here, without any of our drives."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.detectors.lateness import late_drive
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.observed import Observed
from pidtsm_studies.diagnosis.verdict import State

_PERIOD = 0.002
_COUNT = 5000
_TIME: Array = np.linspace(0.0, _PERIOD * (_COUNT - 1), _COUNT)


def _recording(effort: Array, command: Array, position: Array) -> Loop:
    """One joint; efforts answer the command in the next joint state."""
    late = np.vstack([effort[:1], effort[:-1]])
    return Loop(Observed(("joint",), _TIME, position, late, command, position))


def _command(random: np.random.Generator) -> tuple[Array, Array]:
    """A slow motion with friction at its reversals, and what a controller adds: the command and the position."""
    position = np.sin(2.0 * np.pi * 0.2 * _TIME)
    fast = lfilter([0.1], [1.0, -0.9], random.standard_normal(_COUNT))
    return (5.0 * position + 3.0 * fast)[:, np.newaxis], position[:, np.newaxis]


@pytest.mark.parametrize("late", [0.0, 0.008, 0.02, 0.036])
@pytest.mark.parametrize("kind", ["delay", "lag"])
def test_delay_and_lag_are_told_to_within_two_milliseconds_behind_friction_and_noise(kind: str, late: float) -> None:
    random = np.random.default_rng(5)
    command, position = _command(random)
    if kind == "delay":
        effort = np.roll(command, round(late / _PERIOD), axis=0)
    else:
        share = 1.0 - np.exp(-_PERIOD / late) if late else 1.0
        effort = lfilter([share], [1.0, share - 1.0], command, axis=0)
    effort = effort - 2.0 * np.sign(np.gradient(position, axis=0)) + 0.05 * random.standard_normal(effort.shape)
    verdict = late_drive(_recording(effort, command, position))
    assert verdict.value == pytest.approx(late, abs=0.002)
    assert verdict.found == (late > 0.015)
    if verdict.found:
        assert f"controller.drive.{kind}=" in verdict.cure


def test_an_effort_that_has_little_to_do_with_the_command_tells_nothing() -> None:
    random = np.random.default_rng(6)
    command, position = _command(random)
    effort = 0.1 * command + random.standard_normal(command.shape)
    assert late_drive(_recording(effort, command, position)).state is State.UNKNOWN
