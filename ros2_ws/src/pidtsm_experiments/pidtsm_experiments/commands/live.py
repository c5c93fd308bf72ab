"""``./pidtsm live``: the system in real time, and a page that shows it and turns its knobs."""

import argparse
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy

from pidtsm_core.control import LAW_NAME
from pidtsm_core.control.parameters import CONTACT
from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.experiment.node_parameters import WRENCH_PUBLISHED
from pidtsm_experiments.commands.options import CONSOLE, add_experiment_arguments, experiment_of
from pidtsm_experiments.live.nodes import OPERATION, Nodes, live_parameters
from pidtsm_experiments.live.options import add_page_arguments
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_experiments.runs.runner import environment
from pidtsm_ros.startup import start_ros
from pidtsm_ros.stop import Stop

_NAMESPACE = "live"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser, duration=False)
    add_page_arguments(parser)
    parser.epilog = (
        f"With the law {LAW_NAME.default}, the parameters are those of --params {PRACTICAL}, unless others are given."
    )


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options, OPERATION)
    stop = Stop()
    stop.defer()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pidtsm-live-")))
        domain = stack.enter_context(own_domain())
        words = ["-r", f"__ns:=/{_NAMESPACE}"]
        parameters = live_parameters(experiment)
        # The page shows the wrench on the tool, where one can be estimated.
        known = np.any(np.asarray(parameters["controller"].get(CONTACT[0].name, 0.0)))
        parameters["controller"][WRENCH_PUBLISHED.name] = bool(known)
        nodes = Nodes(parameters, folder, lambda node: environment(node, domain, folder), words)
        stack.enter_context(nodes).start_all()
        # Slow to import: the nodes start meanwhile.
        from pidtsm_experiments.live.executable import serve

        CONSOLE.print(f"ROS_DOMAIN_ID={domain}, namespace /{_NAMESPACE}", highlight=False)
        os.environ.update(environment("live", domain, folder))
        start_ros(stop, [])
        try:
            serve(options, stop, nodes, experiment.scenario, f"/{_NAMESPACE}")
        finally:
            rclpy.try_shutdown()
    return 0
