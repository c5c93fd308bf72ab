"""The types of pidtsm_msgs are found wherever its .msg files are."""

import pytest

from pidtsm_experiments.bags.message_types import typestore


def test_messages_beside_the_package_are_found_without_a_sourced_workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    installed = typestore().fielddefs
    typestore.cache_clear()
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert typestore().fielddefs == installed
