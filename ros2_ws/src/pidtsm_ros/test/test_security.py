import pytest

from pidtsm_ros.security import prepare_process


@pytest.mark.parametrize("asked", ["", "false"])
def test_arguments_are_left_alone_without_security(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", asked)
    words = ["controller", "--ros-args", "-p", "law.k1:=3.0"]
    assert prepare_process(words) == words
