"""The controllers of the study."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pidtsm_core.closed_loop import SCHEMAS
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import ARTICLE, PRACTICAL, Experiment, Settings, make_experiment
from pidtsm_studies.reports.labels import label


@dataclass(frozen=True)
class Contender:
    """A controller of the study.

    Attributes:
        name: name in results.
        label: label in tables and figures.
        law: name of the law.
        params: parameter sets, as for `make_experiment`.
        overrides: ``NODE.PARAMETER=VALUE``.
        changes: what a user has added to `params` and `overrides`, as text.
    """

    name: str
    label: str
    law: str
    params: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Short heading."""
        return self.name.replace("_", " ")

    def settings(self, scenario: str, overrides: Sequence[str] = ()) -> Settings:
        """Parameters of a run in this scenario.

        Args:
            scenario: name.
            overrides: ``NODE.PARAMETER=VALUE``, in addition to the contender's own.

        Raises:
            UsageError: unknown scenario or parameter; see `make_experiment`.
        """
        return self._experiment(scenario, overrides).settings

    def check(self, scenario: str) -> None:
        """Check all parameters of a run in this scenario.

        Raises:
            UsageError: an unknown scenario or parameter, or an invalid value.
        """
        self._experiment(scenario, ()).resolved(SCHEMAS)

    def _experiment(self, scenario: str, overrides: Sequence[str]) -> Experiment:
        every = (*self.overrides, *overrides)
        return make_experiment(scenario, self.law, None, self.params, every).without_node_parameters()


OBSERVER = Contender("practical", "PIDDTSM, practical: observer", "piddtsm", (PRACTICAL,))
FILTERED = Contender("article", "PIDDTSM, article: filtered difference", "piddtsm", (ARTICLE,))
DIFFERENTIATOR = Contender(
    "levant",
    "PIDDTSM, article: robust differentiator",
    "piddtsm",
    (ARTICLE,),
    ("controller.estimator.name=robust_differentiator",),
)
CONTENDERS = (
    OBSERVER,
    FILTERED,
    DIFFERENTIATOR,
    *(Contender(law, label(law), law, (ARTICLE,)) for law in ("pidnftsm", "dtsm")),
    *(Contender(law, label(law), law) for law in ("pid", "computed_torque", "super_twisting")),
)
"""In the order of legends. All but `OBSERVER` and `DIFFERENTIATOR` use filtered differences, like the article."""
ESTIMATORS = tuple(c.name for c in (OBSERVER, FILTERED, DIFFERENTIATOR))
"""Names of the proposed law with each estimator."""
LAWS = tuple(c.name for c in CONTENDERS if c not in (FILTERED, DIFFERENTIATOR))
"""Names of the proposed law, the comparators and the baselines."""
LABELS = {c.name: c.label for c in CONTENDERS}
"""Labels by name."""
FOR_REQUIREMENTS = (OBSERVER, FILTERED)
"""Contenders that are tested against the requirements: the set for real hardware, and the article's."""


def choose(laws: Sequence[str] = (), params: Sequence[str] = (), overrides: Sequence[str] = ()) -> list[Contender]:
    """Contenders with other parameters.

    Args:
        laws: laws of the contenders; empty: all.
        params: parameter sets for every contender, after its own, see `make_experiment`.
        overrides: likewise.

    Raises:
        UsageError: no contender has one of the laws.
    """
    known = tuple(dict.fromkeys(contender.law for contender in CONTENDERS))
    if unknown := sorted({*laws} - {*known}):
        raise UsageError(f"law {unknown[0]} is not part of the study: {', '.join(known)}")
    changes = (*(f"--params {name}" for name in params), *(f"--set {text}" for text in overrides))
    return [
        replace(each, params=(*each.params, *params), overrides=(*each.overrides, *overrides), changes=changes)
        for each in CONTENDERS
        if each.law in (laws or known)
    ]


def for_requirements(contenders: Sequence[Contender]) -> list[Contender]:
    """Those of the contenders that are tested against the requirements: all, if `FOR_REQUIREMENTS` are not there."""
    names = {contender.name for contender in FOR_REQUIREMENTS}
    return [contender for contender in contenders if contender.name in names] or list(contenders)
