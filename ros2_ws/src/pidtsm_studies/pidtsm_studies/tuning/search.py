"""The search: CMA-ES (Hansen 2016, arXiv:1604.00772) over a history that survives a kill.

The history has one line per generation, with what the candidates cost. A search that is resumed begins anew with the
same seed, and takes the costs of the generations that are known from the history instead of simulating them. So it has
the same state as one that was never interrupted, to the last bit.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_studies.tuning.objective import Problem, Result, evaluate, total
from pidtsm_studies.tuning.space import Space


@dataclass(frozen=True)
class Budget:
    """When a search ends: after the generation that reaches one of the limits.

    Attributes:
        evaluations: number of controllers, of which the last generation tries no more; 0: no limit.
        seconds: time spent on simulating; 0: no limit.
    """

    evaluations: int = 0
    seconds: float = 0.0

    def share(self, known: "Sequence[Generation]") -> float:
        """Share that is spent, 1 or more when the search ends."""
        spent = []
        if self.evaluations:
            spent.append(sum(len(each.costs) for each in known) / self.evaluations)
        if self.seconds:
            spent.append(sum(each.seconds for each in known) / self.seconds)
        return max(spent, default=0.0)

    def left(self, known: "Sequence[Generation]") -> int | None:
        """How many controllers may still be tried; None: any number."""
        return self.evaluations - sum(len(each.costs) for each in known) if self.evaluations else None


@dataclass(frozen=True)
class Generation:
    """Candidates of a generation and how they do.

    Attributes:
        x: shape (candidates, variables).
        costs, rmse, variation: means over the conditions, shape (candidates,) each; see `Result`.
        seconds: time that the simulation took.
    """

    x: Array
    costs: tuple[float, ...]
    rmse: tuple[float, ...]
    variation: tuple[float, ...]
    seconds: float


def search(
    space: Space,
    problem: Problem,
    identity: Mapping[str, Any],
    history: Path,
    budget: Budget,
    progress: Callable[[Sequence[Generation]], None] = lambda _known: None,
) -> list[Generation]:
    """Tune until the budget is spent.

    Args:
        space: what is tuned.
        problem: what is minimised.
        identity: what defines the search, JSON; ``seed`` is its seed. A history of another search is refused.
        history: file that is continued, or made.
        budget: of the whole search, including what the history contains.
        progress: called after every generation with all of them.

    Returns:
        All generations.

    Raises:
        UsageError: the history is of another search.
    """
    known = _read(history, identity)
    strategy = _strategy(space, int(identity["seed"]), problem.weights["step"])
    generations: list[Generation] = []
    with history.open("a", encoding="utf-8") as file:
        while budget.share(generations) < 1.0:
            asked = np.array(strategy.ask())
            x = asked[: budget.left(generations)]
            line = next(known, None)
            if line is None:
                line = _simulated(space, problem, x)
                file.write(json.dumps(line) + "\n")
                file.flush()
            generations.append(Generation(x, **{name: _values(value) for name, value in line.items()}))
            if len(x) == len(asked):
                strategy.tell(list(x), list(generations[-1].costs))
            progress(generations)
    return generations


def best(generations: Sequence[Generation]) -> tuple[Array, float]:
    """The candidate with the lowest cost, shape (parameters,), and its cost; the first one of several."""
    costs = [min(each.costs) for each in generations]
    generation = generations[int(np.argmin(costs))]
    return generation.x[int(np.argmin(generation.costs))], min(costs)


def _strategy(space: Space, seed: int, step: float) -> Any:
    # Slow to import.
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "randn": np.random.RandomState(seed).randn,
        "seed": np.nan,  # It must not seed the numbers of the whole process.
        "verbose": -9,
        "tolfun": 0.0,
        "tolfunhist": 0.0,
        "tolx": 0.0,
        "tolflatfitness": np.inf,
        "maxiter": np.inf,
    }
    strategy = cma.CMAEvolutionStrategy(space.start, step, options)
    strategy.inject([space.start], force=True)  # So that no search ends worse than it began.
    return strategy


def _simulated(space: Space, problem: Problem, x: Array) -> dict[str, Any]:
    """A line of the history."""
    begin = time.monotonic()
    results = evaluate(problem, [space.controller(each) for each in x])
    return {
        "costs": [total(each) for each in results],
        "rmse": [_mean(each, "rmse") for each in results],
        "variation": [_mean(each, "variation") for each in results],
        "seconds": time.monotonic() - begin,
    }


def _mean(results: Sequence[Result], name: str) -> float:
    return float(np.mean([getattr(each, name) for each in results]))


def _values(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _read(history: Path, identity: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Lines of the history; it is made if it is missing, and loses a last line that is not complete.

    Raises:
        UsageError: it is of another search, or not readable.
    """
    first = json.dumps(dict(identity)) + "\n"
    try:
        text = history.read_text(encoding="utf-8") if history.exists() else ""
        complete = text[: text.rfind("\n") + 1]
        if not complete:
            complete = first
        if not complete.startswith(first):
            raise UsageError(
                f"{history} is of another search: {complete.splitlines()[0]}; choose another --out, or delete the file"
            )
        if complete != text:
            history.write_text(complete, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{history}: {error.strerror}") from None
    return map(json.loads, complete.splitlines()[1:])
