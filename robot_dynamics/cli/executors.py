"""Executors of work on many recordings: this process, several local processes, or a Dask cluster."""

import os
import signal
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.optional_packages import import_optional

CONNECT_TIMEOUT = 10  # [s] for the scheduler to respond
WORKER_TIMEOUT = 30  # [s] for the first worker to connect
MAX_ATTEMPTS = 3  # attempts at a recording whose workers end unexpectedly
BLAS_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def add_executor_arguments(parser: ArgumentParser) -> None:
    """Add the options that select an executor."""
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="number of local processes, each with one recording, or part of a long bag, at a time (default: "
        "%(default)s)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask cluster, such as tcp://host:8786, with a task for each recording, or each part of a long bag; its "
        "workers read the files by the same paths",
    )


@contextmanager
def open_executor(arguments: Namespace) -> Iterator[Executor | None]:
    """Open the executor of parsed arguments; None: this process.

    Raises RobotDynamicsError, also if processes end unexpectedly.
    """
    if arguments.jobs < 1:
        raise RobotDynamicsError(f"--jobs {arguments.jobs}: at least one process is needed")
    if arguments.scheduler is not None and arguments.jobs > 1:
        raise RobotDynamicsError("--jobs and --scheduler exclude each other: use one of the two")
    if arguments.scheduler is not None:
        with _cluster(arguments.scheduler) as executor:
            yield executor
    elif arguments.jobs > 1:
        with _local_processes(arguments.jobs) as executor:
            yield executor
    else:
        yield None


@contextmanager
def _local_processes(jobs: int) -> Iterator[Executor]:
    environment = {name: os.environ.get(name) for name in BLAS_THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(BLAS_THREAD_VARIABLES, "1"))  # BLAS reads it at the start of a process
    try:
        # Spawned, because a fork would copy locks that threads of this process hold. Ctrl-C ends all processes
        # silently; this process reports it.
        with ProcessPoolExecutor(
            jobs,
            mp_context=get_context("spawn"),
            initializer=signal.signal,
            initargs=(signal.SIGINT, signal.SIG_DFL),
        ) as executor:
            yield executor
    except BrokenProcessPool:
        raise RobotDynamicsError(
            f"one of {jobs} processes ended unexpectedly: check whether the memory is sufficient for --jobs {jobs}"
        ) from None
    finally:
        for name, value in environment.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    Client = import_optional("distributed", "--scheduler").Client
    KilledWorker = import_optional("distributed.scheduler", "--scheduler").KilledWorker
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError too
        reason = " ".join(str(error).split())[:200]
        raise RobotDynamicsError(f"--scheduler {address}: no Dask scheduler responds ({reason})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=WORKER_TIMEOUT)
        except TimeoutError:
            raise RobotDynamicsError(
                f"--scheduler {address} has no worker: start one with dask worker {address}"
            ) from None
        try:
            with client.get_executor(pure=False, retries=MAX_ATTEMPTS - 1) as executor:
                yield executor
        except KilledWorker:
            raise RobotDynamicsError(
                f"--scheduler {address}: {MAX_ATTEMPTS} workers ended unexpectedly with the same recording: check "
                "their memory"
            ) from None
