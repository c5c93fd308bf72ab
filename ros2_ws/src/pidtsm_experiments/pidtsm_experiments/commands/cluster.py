"""Where batches are simulated: on this machine, or on the workers of a Dask cluster."""

from collections.abc import Iterator
from contextlib import contextmanager

import joblib

from pidtsm_core.errors import UsageError

TIMEOUT = 10.0
"""Time after which a scheduler that does not answer is given up, s."""


@contextmanager
def workers(scheduler: str | None) -> Iterator[None]:
    """Simulate on the workers of a Dask scheduler within the block; None: on all cores of this machine.

    Raises:
        UsageError: Dask is not installed, or nothing answers at the address.
    """
    if scheduler is None:
        yield
        return
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise UsageError("--scheduler needs Dask: python -m pip install dask[distributed]") from None
    from joblib._dask import DaskDistributedBackend

    class Backend(DaskDistributedBackend):
        """Dask's workers, also if they have one thread in all: joblib would then simulate here."""

        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(int(super().effective_n_jobs(n_jobs)), 2)

    try:
        client = Client(scheduler, timeout=TIMEOUT)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {scheduler}: no scheduler answers ({error})") from None
    with client, joblib.parallel_config(backend=Backend(client=client)):
        yield
