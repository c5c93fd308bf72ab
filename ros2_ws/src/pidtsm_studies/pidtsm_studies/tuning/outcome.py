"""What a tuning has found: gains, how they do on what they were tuned on and on what they were not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_studies.tuning.objective import Problem, Result, evaluate, total
from pidtsm_studies.tuning.search import Generation, best
from pidtsm_studies.tuning.space import Space

SHIFT = 1.25
"""Factor by which the sensitivity changes a gain, down and up."""
_GROUPS = ("law.", "estimator.", "compensation.")


@dataclass(frozen=True)
class Tuning:
    """Result of a tuning.

    Attributes:
        identity: what defines it: arm, law, hardware, objective, seed.
        space: what was tuned.
        generations: of the search.
        x: the best candidate, shape (variables,).
        training, validation: results before and after by condition, see `compared`.
        sensitivity: objective with each gain divided and multiplied by `SHIFT`, within its bounds, minus that of the
            best candidate, shape (2, variables).
    """

    identity: Mapping[str, Any]
    space: Space
    generations: Sequence[Generation]
    x: Array
    training: Mapping[str, tuple[Result, Result]]
    validation: Mapping[str, tuple[Result, Result]]
    sensitivity: Array

    @property
    def parameters(self) -> dict[str, Any]:
        """Gains of law and estimator, and what is compensated."""
        return {n: v for n, v in self.space.controller(self.x).items() if n.startswith(_GROUPS)}

    @property
    def evaluations(self) -> int:
        """Number of controllers that were tried."""
        return sum(len(each.costs) for each in self.generations)

    def objective(self, kind: str) -> tuple[float, float]:
        """The objective before and after, for ``training`` or ``validation``."""
        results = getattr(self, kind).values()
        before, after = (total([pair[i] for pair in results]) for i in (0, 1))
        return before, after


def conclude(
    identity: Mapping[str, Any], space: Space, generations: Sequence[Generation], training: Problem, validation: Problem
) -> Tuning:
    """Judge the best candidate of a search against its start."""
    x, cost = best(generations)
    pair = [space.controller(space.start), space.controller(x)]
    shifted = [space.controller(_shifted(space, x, i, f)) for f in (1.0 / SHIFT, SHIFT) for i in range(x.size)]
    costs = [total(each) for each in evaluate(training, shifted)]
    return Tuning(
        identity=identity,
        space=space,
        generations=generations,
        x=x,
        training=compared(training, pair),
        validation=compared(validation, pair),
        sensitivity=np.reshape(costs, (2, x.size)) - cost,
    )


def compared(problem: Problem, pair: Sequence[Mapping[str, Any]]) -> dict[str, tuple[Result, Result]]:
    """Results of two controllers by condition."""
    before, after = evaluate(problem, pair)
    return {name: (before[i], after[i]) for i, name in enumerate(problem.conditions)}


def parameter_file(tuning: Tuning, command: str) -> str:
    """Content of the ROS parameter file of the controller; `command` is the one that made it."""
    before, after = tuning.objective("training")
    unseen = tuning.objective("validation")
    head = (
        f"# {command}\n"
        f"# {tuning.evaluations} controllers tried. Objective: {before:.4g} before, {after:.4g} after;\n"
        f"# on conditions that were not tuned on {unseen[0]:.4g} before, {unseen[1]:.4g} after.\n"
    )
    return head + ros_parameters("controller", tuning.parameters)


def as_json(tuning: Tuning) -> dict[str, Any]:
    """Content of tuning.json."""
    return {
        **tuning.identity,
        "evaluations": tuning.evaluations,
        "parameters": tuning.parameters,
        "cost": {
            kind: dict(zip(("before", "after"), tuning.objective(kind), strict=True))
            for kind in ("training", "validation")
        },
        **{
            kind: {name: dict(zip(("before", "after"), map(_json, pair), strict=True)) for name, pair in table.items()}
            for kind, table in (("training", tuning.training), ("validation", tuning.validation))
        },
        "sensitivity": {each.label: tuning.sensitivity[:, i].tolist() for i, each in enumerate(tuning.space.variables)},
    }


def _json(result: Result) -> dict[str, Any]:
    finite = {
        name: value if np.isfinite(value) else None
        for name, value in (("rmse_relative", result.rmse), ("variation_relative", result.variation))
    }
    return {"cost": result.cost, **finite, "success": result.success, **result.metrics}


def _shifted(space: Space, x: Array, index: int, factor: float) -> Array:
    """x with one gain changed by a factor, within its bounds."""
    variable, moved = space.variables[index], x.copy()
    moved[index] = min(max(variable.place(variable.value_at(x[index]) * factor), 0.0), 1.0)
    return moved
