"""The same batch on a Dask cluster: here in this process, elsewhere by the address of a scheduler."""

import joblib
import numpy as np
from dask.distributed import Client

import pidtsm_core as pidtsm

seeds = [{"scenario": "noise", "params": "practical", "simulator": {"seed": seed}} for seed in range(20)]
with (
    Client(processes=False, dashboard_address=None) as client,  # elsewhere Client("tcp://ADDRESS:8786")
    joblib.parallel_config(backend="dask", client=client),
):
    result = pidtsm.batch(seeds, duration=2.0, progress=print)

rmse = result.metrics["rmse"]
print(f"RMSE {rmse.mean(axis=0)} rad, standard deviation over the seeds {rmse.std(axis=0)} rad")
local = pidtsm.batch(seeds, duration=2.0)
print("same bits as on this machine's threads:", np.array_equal(rmse, local.metrics["rmse"]))
