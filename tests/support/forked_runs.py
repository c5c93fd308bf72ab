"""Preloaded by what forks nodes, and by a reproduction under test: its runs fork their nodes, too."""

from pidtsm_experiments.runs import runner
from support import nursery_preload  # noqa: F401
from support.nursery import NurseryProcess

runner.Process = NurseryProcess  # type: ignore[misc]
