import pytest

from pidtsm_ros.security import prepare_process


@pytest.mark.parametrize("requested", ["", "false"])
def test_arguments_are_unchanged_without_security(monkeypatch: pytest.MonkeyPatch, requested: str) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", requested)
    words = ["controller", "--ros-args", "-p", "law.k1:=3.0"]
    assert prepare_process(words) == words
