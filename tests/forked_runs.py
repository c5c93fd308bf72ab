"""Preloaded by a reproduction under test: its runs fork their nodes, too."""

import nursery_preload  # noqa: F401
from nursery import NurseryProcess

from pidtsm_experiments.runs import runner

runner.Process = NurseryProcess  # type: ignore[misc]
