"""The controllers of the study."""

from collections.abc import Sequence
from dataclasses import dataclass

from pidtsm_core.experiment import ARTICLE, PRACTICAL, Settings, make_experiment
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
    """

    name: str
    label: str
    law: str
    params: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()

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
        every = (*self.overrides, *overrides)
        return make_experiment(scenario, self.law, None, self.params, every).without_node_parameters().settings


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
