"""The page of the Python interface: every name that the public modules list in `__all__`, with its signature."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

MODULES = ("zenoh_cbef", "zenoh_cbef.api", "zenoh_cbef.plugins", "zenoh_cbef.testing")
"""The modules that a user imports; one that is not there yet is left out."""

_HEAD = """# Python

Made from the code: what a program may import, and what stays as it is from release to release. All other modules may
change at any time. [From Python](../api.md) shows how they go together.
"""


def page() -> str:
    """The page as Markdown."""
    parts, seen = [_HEAD], set()
    for name in MODULES:
        module = import_module(name) if find_spec(name) else None
        told = [(one, thing) for one, thing in _public(module) if id(thing) not in seen] if module else []
        seen |= {id(thing) for _, thing in told}
        if module and told:
            parts.append(f"## `{name}`\n\n{_doc(module)}\n")
            parts += [_entry(one, thing, 3) for one, thing in told]
    if len(parts) == 1:
        parts.append("This version has no such names: programs call the verbs, and read what they export.")
    return "\n".join(parts)


def _public(module: ModuleType) -> Iterator[tuple[str, object]]:
    for name in getattr(module, "__all__", ()):
        thing = getattr(module, name)
        if not inspect.ismodule(thing):
            yield name, thing


def _entry(name: str, thing: object, level: int) -> str:
    head = f"{'#' * level} `{name}`\n"
    if inspect.isclass(thing):
        return "\n".join([head, _signature(name, thing), _doc(thing), "", *_members(name, thing, level)])
    if callable(thing):
        return "\n".join([head, _signature(name, thing), _doc(thing), ""])
    return f"{head}\n`{type(thing).__name__}`\n"


def _members(name: str, cls: type, level: int) -> Iterator[str]:
    """Public methods, properties and fields of a class that this package defines."""
    fields = {one: said for one, said in inspect.get_annotations(cls).items() if not one.startswith("_")}
    if fields:
        yield "| field | type |\n|---|---|\n" + "".join(
            f"| `{one}` | `{_type(said)}` |\n" for one, said in fields.items()
        )
    for one, member in vars(cls).items():
        plain = getattr(member, "__func__", member)
        if one.startswith("_") or one in fields:
            continue
        if callable(plain):
            yield _entry(f"{name}.{one}", plain, level + 1)
        elif isinstance(member, property) or hasattr(member, "func"):
            yield f"{'#' * (level + 1)} `{name}.{one}`\n\n{_doc(getattr(member, 'fget', None) or member.func)}\n"


def _type(said: object) -> str:
    return str(getattr(said, "__name__", said) if isinstance(said, type) else said).replace("|", "\\|")


def _signature(name: str, thing: Callable[..., object]) -> str:
    try:
        said = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    return f"```python\n{name}{said}\n```\n"


def _doc(thing: object) -> str:
    return inspect.getdoc(thing) or ""
