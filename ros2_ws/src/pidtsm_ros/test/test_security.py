import os

import pytest

from pidtsm_ros.security import guarded

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.mark.parametrize(("given", "then"), [(None, "LOCALHOST"), ("SUBNET", "SUBNET"), ("OFF", "OFF")])
def test_discovery_stays_on_this_machine_unless_somebody_wants_it_wider(
    monkeypatch: pytest.MonkeyPatch, given: str | None, then: str
) -> None:
    # Set before it is removed, so that what is set by the function is undone, too.
    monkeypatch.setenv(RANGE, given or "")
    if given is None:
        del os.environ[RANGE]
    guarded(["controller"])
    assert os.environ[RANGE] == then


@pytest.mark.parametrize("asked", ["", "false"])
def test_arguments_are_left_alone_without_security(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", asked)
    words = ["controller", "--ros-args", "-p", "law.k1:=3.0"]
    assert guarded(words) == words
