"""Who does the work on many recordings: this process, several on this machine, or a Dask cluster."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.optional_packages import import_optional

CONNECT_TIMEOUT = 10  # [s] in which a scheduler must answer
WORKER_TIMEOUT = 30  # [s] in which it must have a worker
MAX_ATTEMPTS = 3  # workers that may be lost with a recording
BLAS_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # of a BLAS in each process


def add_executor_arguments(parser):
    parser.add_argument("--jobs", type=int, default=1, metavar="N",
                        help="processes on this machine, a recording each (default: %(default)s)")  # fmt: skip
    parser.add_argument("--scheduler", metavar="ADDRESS",
                        help="Dask cluster, such as tcp://host:8786, that takes a recording a task; its workers read "
                        "the files by the same paths")  # fmt: skip


@contextmanager
def open_executor(told):
    """The concurrent.futures.Executor that parsed arguments ask for, None for this process. Raises RobotDynamicsError,
    also where processes end in the middle of their work."""
    if told.jobs < 1:
        raise RobotDynamicsError(f"--jobs {told.jobs}: at least one process is needed")
    if told.scheduler is not None and told.jobs > 1:
        raise RobotDynamicsError("--jobs and --scheduler: one of the two says who does the work")
    if told.scheduler is not None:
        with _cluster(told.scheduler) as executor:
            yield executor
    elif told.jobs > 1:
        with _processes(told.jobs) as executor:
            yield executor
    else:
        yield None


@contextmanager
def _processes(jobs):
    before = {name: os.environ.get(name) for name in BLAS_THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(BLAS_THREAD_VARIABLES, "1"))  # a BLAS reads it when a process begins
    try:
        # spawned: a fork would copy locks that threads of this process hold. Ctrl-C ends all processes, of which this
        # one tells it
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=signal.signal,
                                 initargs=(signal.SIGINT, signal.SIG_DFL)) as executor:  # fmt: skip
            yield executor
    except BrokenProcessPool:
        raise RobotDynamicsError(
            f"one of {jobs} processes ended in the middle of its work: was there too little memory for --jobs {jobs}?"
        ) from None
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextmanager
def _cluster(address):
    Client = import_optional("distributed", "--scheduler").Client
    KilledWorker = import_optional("distributed.scheduler", "--scheduler").KilledWorker
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:  # OSError is a time-out too
        told = " ".join(str(error).split())[:200]
        raise RobotDynamicsError(f"--scheduler {address}: no Dask scheduler answers ({told})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=WORKER_TIMEOUT)
        except TimeoutError:
            raise RobotDynamicsError(f"--scheduler {address} has no worker: dask worker {address}") from None
        try:
            with client.get_executor(pure=False, retries=MAX_ATTEMPTS - 1) as executor:
                yield executor
        except KilledWorker:
            raise RobotDynamicsError(
                f"--scheduler {address}: {MAX_ATTEMPTS} workers ended in the middle of a recording: out of memory?"
            ) from None
