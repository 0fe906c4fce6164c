"""Work of many runs, spread over the cores of this host, or over the workers of a Dask scheduler."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from multiprocessing import resource_tracker
from types import ModuleType
from typing import TypeVar

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import MissingExtra, from_extra
from zenoh_cbef.machine import core_count
from zenoh_cbef.scenario import Scenario

_BATCH = 324_000
"""Rows times steps of one batch. Larger ones are no faster per run, and take memory."""

_SHARED = 100_000
"""Rows times steps from which on two processes are sooner done than one."""

Task = TypeVar("Task")
Found = TypeVar("Found")


def at_once(scenario: Scenario) -> int:
    """How many seeds of a scenario are one batch at most."""
    return max(1, _BATCH // (scenario.count * scenario.length))


def batches(scenario: Scenario, runs: int, jobs: int) -> int:
    """In how many batches so many runs of a scenario are done: as many for each process as for any other."""
    if runs * scenario.count * scenario.length <= _SHARED:
        return 1
    each = workers(jobs)
    return min(runs, -(-runs // (each * at_once(scenario))) * each)


def workers(jobs: int) -> int:
    """How many processes work at a time where so many are asked for; 0: one per core that this process may use."""
    return jobs or core_count()


def spread(
    do: Callable[[Task], Found],
    work: Sequence[Task],
    jobs: int,
    *,
    dask: str | None = None,
    tell: Callable[[str], None],
) -> Iterator[Found]:
    """What `do` makes of each piece of work, as they get done; one piece is done in this process.

    jobs: see `workers`. dask: the address of a Dask scheduler, whose workers do it in place of processes on this host.
    tell gets a sentence where one core has to do the work of all.
    """
    few = min(workers(jobs), len(work)) <= 1
    joblib = None if dask is None and few else _joblib(tell, required=dask is not None)
    if joblib is None:
        with _ended_by_a_request():
            yield from map(do, work)
        return
    with _ended_by_a_request(), _back_end(joblib, dask):
        number = workers(jobs) if dask is None else -1
        parallel = joblib.Parallel(n_jobs=number, return_as="generator_unordered", batch_size=1)
        yield from _results(parallel, [joblib.delayed(do)(one) for one in work])


def _joblib(tell: Callable[[str], None], *, required: bool) -> ModuleType | None:
    """The module joblib, which spreads the work; None where it is not installed: one core then does all."""
    try:
        return from_extra("joblib", "simulating on several cores")
    except MissingExtra as missing:
        if required:
            raise
        tell(f"{missing}; until then one core simulates")
        return None


def _results(parallel: Callable[[list[object]], Generator[Found]], tasks: list[object]) -> Iterator[Found]:
    """What the workers return, as it comes.

    The workers ignore Ctrl-C, as they would print tracebacks: this process ends them.
    """
    let_joblib_drop_work()
    resource_tracker.ensure_running()  # its first start would let interrupts through again
    with ExitStack() as stack, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of work that is lost, when it is interrupted
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        stack.callback(signal.pthread_sigmask, signal.SIG_SETMASK, heard)
        with closing(parallel(tasks)) as results:
            stack.close()
            yield from results


@contextmanager
def _ended_by_a_request() -> Iterator[None]:
    """Let SIGTERM do what Ctrl-C does: joblib, if its process just died of it, would complain of what it left."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def let_joblib_drop_work() -> None:
    """From now on joblib's own thread prints no traceback where Ctrl-C took work away before it could hand it on."""
    before = threading.excepthook

    def tell(failed: threading.ExceptHookArgs) -> None:
        name = None if failed.thread is None else failed.thread.name
        if not (name == "ExecutorManagerThread" and failed.exc_type is KeyError):
            before(failed)

    threading.excepthook = tell


@contextmanager
def _back_end(joblib: ModuleType, dask: str | None) -> Iterator[None]:
    """Tell joblib where to simulate."""
    if dask is None:
        yield
        return
    distributed = from_extra("distributed", "--dask")
    try:
        client = distributed.Client(dask, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise UserError(f"no Dask scheduler answers at {dask}: {error}; start one, or leave out --dask") from None
    with client, joblib.parallel_config("dask"):
        yield
