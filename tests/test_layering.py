"""Every import points down, heavy libraries stay in their rooms, and nothing grows too long."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = "zenoh_cbef"
ROOT = Path(__file__).resolve().parents[1] / PACKAGE
FILES = sorted(ROOT.rglob("*.py"))

# From the top down. A part imports itself and what stands below; what shares a level does not know each other.
LEVELS = (
    ("cli",),
    ("api",),
    ("experiment",),
    ("nodes", "lab"),
    ("viewers",),
    ("log",),
    ("simulator", "analysis", "extending", "testing"),
    ("trace", "outside", "pages"),
    ("protocol", "scenario"),
    ("faults",),
    ("courses", "datasets", "tracking"),
    ("streams", "extras", "numbers", "quantities", "plain", "machine", "plugins", "writing"),
    ("arrays", "errors", "words", "__init__"),
    ("checkout",),
)
FRONT_DOOR = ROOT / "__init__.py"
"""Names what `import zenoh_cbef` offers, for tools that read types; it imports `api` when a program asks for it."""

LEVEL = {part: level for level, parts in enumerate(LEVELS) for part in parts}
OWNERS = {
    "zenoh": "protocol",
    "mcap": "log",
    "zstandard": "log",
    "typer": "cli",
    "rich": "cli",
    "msgpack": "protocol",
    "cryptography": "protocol",
    "jinja2": "pages",
    "starlette": "lab",
    "uvicorn": "lab",
    "foxglove": "lab",
}


ROOMS = {
    "cli": (("calling",), ("options",), ("terminal",)),
    "nodes": (("agent", "target", "recorder", "receiver", "replay", "launch"), ("common",)),
    "log": (("prove", "tools"), ("read", "write"), ("common", "mcap")),
}
"""Parts that have rooms, from the top down: a room knows itself and what stands below, never what stands beside.

Files of such a part itself, as those of verbs, stand above its rooms."""


def part_of(path: Path) -> str:
    inside = path.relative_to(ROOT).parts
    if inside == ("__main__.py",):
        return "cli"
    return inside[0].removesuffix(".py")


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> list[tuple[int, str]]:
    """Line and full name of everything that a file imports, wherever in it."""
    found = []
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
    return found


def imported_part(name: str) -> str | None:
    package, *inside = name.split(".")
    if package != PACKAGE:
        return None
    return inside[0] if inside and not inside[0].startswith("__") else "__init__"


def place(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT.parent)}:{line}"


def test_every_part_has_a_level():
    assert {part_of(path) for path in FILES} <= LEVEL.keys()


@pytest.mark.slow
def test_imports_point_down():
    upward = [
        f"{place(path, line)}: {part_of(path)} imports {part}"
        for path in FILES
        for line, name in imports(path)
        if (part := imported_part(name)) is not None
        and part != part_of(path)
        and LEVEL[part] <= LEVEL[part_of(path)]
        and not (path == FRONT_DOOR and part in {"api", "errors"})
    ]
    assert upward == []


@pytest.mark.parametrize("part", ROOMS)
def test_rooms_of_a_part_know_only_themselves_and_those_below(part):
    level = {room: number for number, rooms in enumerate(ROOMS[part]) for room in rooms}
    astray = [
        f"{place(path, line)} imports {name}"
        for path in FILES
        if part_of(path) == part and path.parent.name not in {part, PACKAGE}
        for line, name in imports(path)
        if name.startswith(f"{PACKAGE}.{part}.")
        and (other := name.split(".")[2]) != (room := path.parent.name)
        and level.get(other, -1) <= level[room]
    ]
    assert astray == []


def test_within_a_part_imports_make_no_circle():
    edges = {}
    names = {path: ".".join((PACKAGE, *path.relative_to(ROOT).with_suffix("").parts)) for path in FILES}
    modules = {name.removesuffix(".__init__"): path for path, name in names.items()}
    for path in FILES:
        wanted = {name for _, full in imports(path) for name in (full, full.rpartition(".")[0])}
        edges[path] = {modules[name] for name in wanted if name in modules} - {path}
    edges[FRONT_DOOR] = {ROOT / "checkout.py"}
    # A package's own __init__ gathers what stands in it, and is not what its files lean on.
    for path in FILES:
        edges[path] = {other for other in edges[path] if other != path.parent / "__init__.py"}
    while leaves := [path for path, wanted in edges.items() if not wanted]:
        for leaf in leaves:
            del edges[leaf]
        for others in edges.values():
            others.difference_update(leaves)
    assert [names[path] for path in edges] == []


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_stays_in_its_room(library):
    astray = [
        f"{place(path, line)} imports {name}"
        for path in FILES
        for line, name in imports(path)
        if name.split(".")[0] == library and part_of(path) != OWNERS[library]
    ]
    assert astray == []


def test_the_tracker_has_no_clock_socket_or_thread():
    forbidden = {"asyncio", "datetime", "os", "random", "select", "signal", "socket", "subprocess", "threading", "time"}
    astray = [
        f"{place(path, line)} imports {name}"
        for path in FILES
        if part_of(path) in {"tracking", "streams", "faults", "scenario", "simulator"}
        for line, name in imports(path)
        if name.split(".")[0] in forbidden or name.startswith("numpy.random")
    ]
    assert astray == []


def test_files_stay_below_300_lines():
    long = {place(path, n): n for path in FILES if (n := len(path.read_text(encoding="utf-8").splitlines())) >= 300}
    assert long == {}


@pytest.mark.parametrize("part", LEVEL)
def test_functions_stay_below_50_lines(part):
    long = [
        f"{place(path, node.lineno)} {node.name}: {lines} lines"
        for path in FILES
        if part_of(path) == part
        for node in ast.walk(tree(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (lines := (node.end_lineno or node.lineno) - node.lineno + 1) >= 50
    ]
    assert long == []
