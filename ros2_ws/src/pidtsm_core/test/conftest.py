"""Hypothesis for compiled code: no deadlines, and no tracing of it to explain a failure, which takes for ever.

And the parameters of ``config/practical.yaml``.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import Phase, settings

settings.register_profile("compiled", deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
settings.load_profile("compiled")

PRACTICAL = Path(__file__).parents[2] / "pidtsm_controller" / "config" / "practical.yaml"


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


@pytest.fixture(scope="session")
def practical() -> dict[str, Any]:
    """Parameters of the controller for arms with encoders, delays and a model that is roughly right."""
    if not PRACTICAL.is_file():
        pytest.skip("the controller's parameter sets are not beside this package")
    return dict(_flat(yaml.safe_load(PRACTICAL.read_text())["controller"]["ros__parameters"]))
