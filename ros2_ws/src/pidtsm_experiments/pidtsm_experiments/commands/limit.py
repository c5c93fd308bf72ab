"""``./pidtsm limit``: the smallest RMSE that any controller can reach."""

import argparse
import json

from rich.console import Console

from pidtsm_core.experiment import DEFAULT_SCENARIO, make_experiment
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.errors import RunError
from pidtsm_studies.limit.optimal import find_limit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenario",
        default=DEFAULT_SCENARIO,
        metavar="NAME|FILE",
        help="of the two-link arm without a payload (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object: scenario and RMSE of each joint")


def execute(options: argparse.Namespace) -> int:
    experiment = make_experiment(options.scenario)
    try:
        with CONSOLE.status("optimising"):
            found = find_limit(experiment)
    except RuntimeError as error:
        raise RunError(f"the optimisation has not converged: {error}") from None
    if options.json:
        print(json.dumps({"scenario": experiment.scenario, "rmse": found.rmse}))
    else:
        values = " and ".join(f"{each:.5f}" for each in found.rmse)
        Console().print(f"No controller has a smaller RMSE in {experiment.scenario} than {values} rad", highlight=False)
    return 0
