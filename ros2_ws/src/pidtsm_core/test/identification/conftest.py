"""Arms whose parameters are known, and measurements of them."""

import pytest
from support.knownarm import KnownArm, known_arm


@pytest.fixture(scope="session")
def panda() -> KnownArm:
    return known_arm("panda")


@pytest.fixture(scope="session")
def two_link() -> KnownArm:
    return known_arm("two_link")
