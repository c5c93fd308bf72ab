"""Studies of controllers without ROS: the article, scores, tuning, reports, theory.

    from pidtsm_studies import check_gains

    check = check_gains("case1", controller={"law.k1": 4.0})
    print(check, check.violated, check.bounds.settling)

Where this package is installed, `pidtsm_core` has `check_gains` too. Units and the order of joints are those of
`pidtsm_core`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pidtsm_studies.theory.check import GainCheck, check_gains

_MODULES = {"GainCheck": "theory.check", "check_gains": "theory.check"}
"""Module of each public name: imported when it is first used, because importing the compiler takes half a second."""

__all__ = ["GainCheck", "check_gains"]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
