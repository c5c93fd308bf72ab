"""Results of the robustness study: real ones, and ones with failures."""

from collections.abc import Iterable

import numpy as np
import pytest

from pidtsm_core.batches import BatchResult, Settings
from pidtsm_studies.robustness import study
from pidtsm_studies.robustness.results import FULL, QUICK, Robustness


@pytest.fixture(scope="session")
def quick() -> Robustness:
    """Results for two values and two seeds."""
    return study.measure(QUICK)


@pytest.fixture(scope="session")
def with_failures() -> Robustness:
    """All runs succeed except some of the first ones, the first contender's with increasingly coarse encoders."""

    def batch(settings: Iterable[Settings], *_: object, **__: object) -> BatchResult:
        runs = len(list(settings))
        good = {"rmse": 0.04, "eci": 30.0, "torque_variation": 0.01, "late_error": 0.0199, "late_saturation": 0.0}
        table = {name: np.full((runs, 2), value) for name, value in good.items()}
        for values in table.values():
            values[3] = np.nan
        table["late_error"][4, 1] = 0.02
        table["late_saturation"][5, 0] = 1e-4
        return BatchResult(table, {3: "the loop is not finite any more after 1 s"}, [])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "batch", batch)
        return study.measure(FULL)
