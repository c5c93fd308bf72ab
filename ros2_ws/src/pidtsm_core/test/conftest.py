"""Hypothesis for compiled code: no deadlines, and no slow tracing to explain failures.

Also fixtures of several tests: arms with different numbers of joints, and a run of Case 1.
"""

import pytest
from hypothesis import Phase, settings
from support.testarms import ARMS, Arm

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout

settings.register_profile("compiled", deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
settings.load_profile("compiled")


@pytest.fixture(scope="module", params=ARMS, ids=str)
def arm(request: pytest.FixtureRequest) -> Arm:
    """Every test that asks for it runs with 1, 2, 3 and 7 joints."""
    arm: Arm = request.param
    return arm


@pytest.fixture(scope="session")
def run() -> Recording:
    """Two seconds of Case 1."""
    return rollout(duration=2.0)
