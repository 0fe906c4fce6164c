"""What a mutant changes: one place of a source file, one way."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard, TypeVar

Node = TypeVar("Node", bound=ast.AST)
Change = tuple[str, ast.AST]
"""How it is told, and what stands in the node's place."""

OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.MatMult: ast.Add,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
NAMES = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "any": "all", "all": "any"}
_NOT_RUN = {"annotation", "returns", "decorator_list"}
_WAITS = re.compile(r"[A-Z_]+_(SECONDS|MS)")
_WAIT_KEYS = re.compile(r"period_\w+|.*/(delay|open_timeout)")
"""Names of what says how long a process waits: constants, and settings of Zenoh."""
_CLOCKS = {"monotonic", "time"}


@dataclass(frozen=True)
class Mutant:
    """A file's mutant. number: of the node, in the order of the walk. way: of the node's changes.

    statement: the line where the innermost statement begins. called: it runs in calls alone, not as its file is
    imported.
    """

    path: Path
    line: int
    statement: int
    called: bool
    number: int
    way: int
    change: str

    @property
    def place(self) -> tuple[str, int]:
        """Its file, and the line where its innermost statement begins."""
        return str(self.path), self.statement

    def tree(self) -> ast.Module:
        """The mutated source."""
        module = ast.parse(self.path.read_text(encoding="utf-8"))
        target = list(_walk(module))[self.number].node
        changed = ast.copy_location(_changes(target)[self.way][1], target)
        _Replace(target, changed).visit(module)
        return ast.fix_missing_locations(module)

    def told(self, root: Path) -> str:
        """Where it is and what it changes."""
        return f"{self.path.relative_to(root)}:{self.line}: {self.change}"


def mutants_of(path: Path) -> list[Mutant]:
    """All mutants of a source file."""
    return [
        Mutant(path, getattr(place.node, "lineno", 0), place.statement, place.called, number, way, told)
        for number, place in enumerate(_walk(ast.parse(path.read_text(encoding="utf-8"))))
        for way, (told, _) in enumerate(_changes(place.node))
    ]


class _Replace(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else self.generic_visit(node)


@dataclass(frozen=True)
class _Place:
    node: ast.AST
    statement: int
    called: bool


def _walk(node: ast.AST, statement: int = 0, called: bool = False) -> Iterator[_Place]:
    """All that runs, without annotations, the sentences of errors, and what `_is_left_out`."""
    if _is_left_out(node):
        return
    if isinstance(node, ast.stmt):
        statement = node.lineno
    yield _Place(node, statement, called)
    for name, value in ast.iter_fields(node):
        if name in _NOT_RUN or isinstance(node, ast.Raise):
            continue
        inside = called or (name == "body" and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
        children = value if isinstance(value, list) else [value]
        if isinstance(node, ast.Dict):
            children = [child for key, child in zip(node.keys, children, strict=True) if not _is_wait(key)]
        for child in children:
            if _is_rest(child, node):
                yield _Place(child, statement, inside)
            elif isinstance(child, ast.AST):
                yield from _walk(child, statement, inside)


def _is_left_out(node: ast.AST) -> bool:
    """Whether what is here is right in many ways, or not run; docs/mutants.md says why."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)]):
            return _WAITS.fullmatch(name) is not None
        case ast.Assign(targets=[ast.Tuple(elts=names)]):
            return all(isinstance(one, ast.Name) and _WAITS.fullmatch(one.id) for one in names)
        case ast.keyword(arg="strict") | ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return True
        case ast.Expr(value=ast.Call(func=ast.Attribute(value=ast.Name(id="time"), attr="sleep"))):
            return True
    return False


def _changes(node: ast.AST) -> list[Change]:
    return [*_of_operators(node), *_of_values(node), *_of_statements(node)]


def _of_operators(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.BinOp(op=op) | ast.BoolOp(op=op) | ast.AugAssign(op=op) | ast.Compare(ops=[op]):
            if type(op) in OPERATORS and not (isinstance(node, ast.Compare) and _is_of_a_clock(node)):
                other = OPERATORS[type(op)]()
                told = f"{type(op).__name__} becomes {type(other).__name__}"
                yield told, _with(node, **({"ops": [other]} if isinstance(node, ast.Compare) else {"op": other}))
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield f"{ast.unparse(node)} becomes {ast.unparse(operand)}", operand


def _is_rest(node: object, call: ast.AST) -> TypeGuard[ast.UnaryOp]:
    """Whether it is the length that NumPy finds out: any negative number stands for that."""
    reshapes = isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "reshape"
    return reshapes and isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _is_wait(key: ast.AST | None) -> bool:
    return isinstance(key, ast.Constant) and _WAIT_KEYS.fullmatch(str(key.value)) is not None


def _is_of_a_clock(node: ast.Compare) -> bool:
    """Whether it compares a time of this moment: which side the moment itself is on makes no difference."""
    called = [one.func for one in ast.walk(node) if isinstance(one, ast.Call)]
    return any(isinstance(one, ast.Attribute) and one.attr in _CLOCKS for one in called)


def _of_values(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Constant(value=bool() as value):
            yield f"{value} becomes {not value}", ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield f"{value} becomes {value + 1}", ast.Constant(value + 1)
        case ast.Attribute(attr=name) if name in NAMES:
            yield f"{name} becomes {NAMES[name]}", _with(node, attr=NAMES[name])
        case ast.Name(id=name) if name in NAMES:
            yield f"{name} becomes {NAMES[name]}", _with(node, id=NAMES[name])
        case ast.IfExp(test=test):
            yield f"{ast.unparse(test)} is denied", _with(node, test=ast.UnaryOp(ast.Not(), test))


def _of_statements(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.If(test=test) | ast.While(test=test):
            yield f"{ast.unparse(test)} is denied", _with(node, test=ast.UnaryOp(ast.Not(), test))
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) not in {"None", "False"}:
            yield f"returns None, not {ast.unparse(value)}", _with(node, value=ast.Constant(None))
        case ast.Expr(value=ast.Call()):
            yield f"without {ast.unparse(node)}", ast.Pass()
        case ast.Continue():
            yield "continue becomes break", ast.Break()
        case ast.Break():
            yield "break becomes continue", ast.Continue()


def _with(node: Node, **fields: object) -> Node:
    return type(node)(**{**dict(ast.iter_fields(node)), **fields})
