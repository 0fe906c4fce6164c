"""Which tests reach which statement: only those are tried on a statement's mutants."""

from __future__ import annotations

import ast
import builtins
import gc
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

from benchmarks.putting import put

Place = tuple[str, int]
"""A statement: its file, and the line where it begins."""

_MARK = "_statement_reached"
_CACHED = type(cache(len))


@dataclass
class Reach:
    """What tests reach, by their ids, and how long they take. imported: what runs before the first test."""

    imported: set[Place] = field(default_factory=set)
    tests: dict[str, set[Place]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


class Reaching:
    """A pytest plugin that fills a `Reach`, of some statements alone."""

    def __init__(self, places: set[Place]) -> None:
        self.reach = Reach()
        self._now: set[Place] = set()
        self._set_up: dict[Path, set[Place]] = defaultdict(set)
        self._files: dict[str, Path] = {}
        setattr(builtins, _MARK, lambda path, line: self._now.add((path, line)))
        files = {Path(path) for path, _ in places}
        replace_code(files, lambda path: _marked(path, places))

    def pytest_runtestloop(self) -> None:
        """Pytest's hook."""
        self.reach.imported = self._taken()
        gc.unfreeze()
        self._caches = [one for one in gc.get_objects() if type(one) is _CACHED]

    def pytest_runtest_logstart(self) -> None:
        """Pytest's hook: what an earlier test left in a cache is computed again, as this one reaches it, too."""
        for cached in self._caches:
            cached.cache_clear()
        self._taken()
        self._began = time.monotonic()

    def pytest_runtest_call(self, item: Any) -> None:
        """Pytest's hook: a fixture that was set up may be that of all tests of the file."""
        self._files[item.nodeid] = item.path
        self._set_up[item.path] |= self._taken()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Pytest's hook."""
        self.reach.tests[nodeid] = self._taken()
        self.reach.seconds[nodeid] = time.monotonic() - self._began

    def pytest_sessionfinish(self) -> None:
        """Pytest's hook."""
        for test, path in self._files.items():
            self.reach.tests[test] |= self._set_up[path]

    def _taken(self) -> set[Place]:
        # A thread of a test may add to the set at any time: the one of before stays its own.
        taken, self._now = self._now, set()
        return taken


def replace_code(files: set[Path], tree: Callable[[Path], ast.Module]) -> None:
    """Those of the files that are imported from now on have this syntax tree."""
    honest = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, fullname: str) -> Any:
        path = Path(self.path)
        return compile(tree(path), self.path, "exec") if path in files else honest(self, fullname)

    put(SourceFileLoader, "get_code", get_code)


def _marked(path: Path, places: set[Place]) -> ast.Module:
    module = ast.parse(path.read_text(encoding="utf-8"))
    for node in list(ast.walk(module)):
        for name in ("body", "orelse", "finalbody"):
            statements = getattr(node, name, None)
            if isinstance(statements, list):
                setattr(node, name, list(_with_marks(statements, path, places)))
    return ast.fix_missing_locations(module)


def _with_marks(statements: list[ast.stmt], path: Path, places: set[Place]) -> Iterator[ast.stmt]:
    for statement in statements:
        if (str(path), statement.lineno) in places:
            arguments = [ast.Constant(str(path)), ast.Constant(statement.lineno)]
            call = ast.Call(ast.Name(_MARK, ast.Load()), list(arguments), [])
            yield ast.copy_location(ast.Expr(call), statement)
        yield statement
