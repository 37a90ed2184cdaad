"""A Dask cluster of two processes on this machine."""

from contextlib import contextmanager

import pytest


@contextmanager
def local_cluster():
    """Open the cluster; without dask[distributed] the test is skipped."""
    distributed = pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs="ERROR"
    ) as cluster:
        yield cluster


@contextmanager
def cluster_executor():
    """Open the cluster, with an executor of concurrent.futures for it."""
    from distributed import Client

    with (
        local_cluster() as cluster,
        Client(cluster, timeout=30, set_as_default=False) as client,
        client.get_executor(pure=False) as executor,
    ):
        yield executor
