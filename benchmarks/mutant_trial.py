"""Tries one mutant after the other on tests that were collected once, each in a fork of its own."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import resource
import signal
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from types import CodeType, FunctionType

import pytest

from benchmarks.mutant_reach import replace_code
from benchmarks.mutations import Mutant

KILLED, HANGS, SURVIVES, IMPORTED = range(4)
"""What becomes of a mutant. IMPORTED: not known, as it acts when its file is imported."""


_DIES_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux


class Crew:
    """Processes that take turns with numbers, and tell what they find for each."""

    def __init__(self, jobs: int) -> None:
        self._context = multiprocessing.get_context("fork")
        self._turn, self._told = self._context.Value("i", 0), self._context.SimpleQueue()
        self._jobs = jobs

    def turn(self) -> int:
        """The next number."""
        with self._turn.get_lock():
            self._turn.value += 1
            return int(self._turn.value - 1)

    def tell(self, number: int, found: int) -> None:
        """What was found for a number."""
        self._told.put((number, found))

    def found(self, work: Callable[[], None], count: int) -> Iterator[tuple[int, int]]:
        """What processes that do the work tell, until they have told so many. They take turns from 0."""
        with self._turn.get_lock():
            self._turn.value = 0
        workers = [self._context.Process(target=work) for _ in range(self._jobs)]
        for worker in workers:
            worker.start()
        for _ in range(count):
            while self._told.empty():
                working = any(worker.is_alive() for worker in workers)
                time.sleep(0.01)
                if not working and self._told.empty():
                    raise RuntimeError("the processes that try mutants ended too early")
            yield self._told.get()
        for worker in workers:
            worker.join()


@dataclass(frozen=True)
class Trial:
    """A mutant, None for the source as it is, and the tests that it meets, with how long they take without it.

    imported: it acts when its file is imported.
    """

    mutant: Mutant | None
    tests: dict[str, float]
    imported: bool = False

    @property
    def seconds(self) -> float:
        """How long all tests take."""
        return sum(self.tests.values())


class Trying:
    """A pytest plugin that runs, in place of all tests once, those of one trial after the other.

    turn: gives the number of the next trial; tell: takes what became of it.
    """

    def __init__(self, trials: list[Trial], turn: Callable[[], int], tell: Callable[[int, int], None]) -> None:
        self._trials, self._turn, self._tell = trials, turn, tell

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Pytest's hook."""
        gc.unfreeze()  # what conftest.py has hidden from the collector
        functions = defaultdict(list)
        for function in [one for one in gc.get_objects() if isinstance(one, FunctionType)]:
            functions[function.__code__.co_filename].append(function)
        items = {item.nodeid: item for item in session.items}
        while (number := self._turn()) < len(self._trials):
            self._tell(number, _found(self._trials[number], session, items, functions))
        return True


def _found(
    trial: Trial, session: pytest.Session, items: dict[str, pytest.Item], functions: dict[str, list[FunctionType]]
) -> int:
    def work() -> int:
        if trial.mutant is not None and not _mutated(trial.mutant, functions[str(trial.mutant.path)]):
            return IMPORTED
        return _passed(trial, session, items)

    return IMPORTED if trial.imported else in_fork(work, trial.seconds)


def _passed(trial: Trial, session: pytest.Session, items: dict[str, pytest.Item]) -> int:
    chosen = [items[test] for test in trial.tests]
    for item, following in zip_longest(chosen, chosen[1:]):
        # A mutant that hangs does so in one test: the fork ends by the signal.
        signal.setitimer(signal.ITIMER_REAL, 20 + 10 * trial.tests[item.nodeid])
        session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return KILLED
    return SURVIVES


def in_fork(work: Callable[[], int], seconds: float) -> int:
    """What a fork finds. seconds: what its tests took without a mutant; what takes far longer hangs."""
    child = os.fork()
    if child == 0:
        found = KILLED
        try:
            os.setpgid(0, 0)
            ctypes.CDLL(None).prctl(_DIES_WITH_PARENT, signal.SIGKILL)
            most = int(30 + 5 * seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (most, most))
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            found = work()
        finally:
            os._exit(found)
    return _ended(child, 60 + 10 * seconds)


def _ended(child: int, seconds: float) -> int:
    """What a child found; its own children end with it."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and not os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        time.sleep(0.005)
    os.killpg(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code < 0:
        return HANGS if -code in {signal.SIGALRM, signal.SIGKILL, signal.SIGXCPU} else KILLED
    return code


def _mutated(mutant: Mutant, functions: list[FunctionType]) -> bool:
    """Whether all functions of the file could be given the mutant's code."""
    replace_code({mutant.path}, lambda _: mutant.tree())
    codes = defaultdict(list)
    for code in _codes(compile(mutant.tree(), str(mutant.path), "exec")):
        codes[_name(code)].append(code)
    for function in functions:
        found = codes[_name(function.__code__)]
        if len(found) != 1 or found[0].co_freevars != function.__code__.co_freevars:
            return False
        function.__code__ = found[0]
    return True


def _name(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)
