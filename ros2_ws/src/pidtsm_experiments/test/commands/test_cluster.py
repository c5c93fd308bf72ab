"""The workers of a Dask cluster simulate, however few they are."""

import os

import pytest

from pidtsm_core.rollouts.batches import batch
from pidtsm_experiments.commands.cluster import workers


def test_a_cluster_with_one_thread_simulates_instead_of_this_process() -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        workers(cluster.scheduler_address),
    ):
        result = batch([{}, {}], 0.01, measure=lambda run: {"process": [os.getpid()] * len(run.joints)})
    (process,) = {int(value) for value in result.metrics["process"].ravel()}
    assert process != os.getpid()
