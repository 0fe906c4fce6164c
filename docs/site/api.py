"""The page of the Python interface: every name that the public modules list in `__all__`, with its signature."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from importlib import import_module

from zenoh_cbef.api.simulating import scenario

MODULES = ("zenoh_cbef", "zenoh_cbef.extending", "zenoh_cbef.testing")
"""The modules that a user imports."""

_QUOTED = re.compile(r"(?<=: |> )'([^']*)'")
_FUNCTION = re.compile(r"<function .*?>(?: at 0x[0-9a-f]+>)?")

_HEAD = """# Python

Made from the code: what a program may import, and what stays as it is from release to release. All other modules may
change at any time. [From Python](../api.md) shows how the names of `zenoh_cbef` go together, and
[plugins](../plugins.md) those of `zenoh_cbef.extending` and `zenoh_cbef.testing`.
"""


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD]
    for name in MODULES:
        module = import_module(name)
        parts.append(f"## `{name}`\n\n{_doc(module)}\n")
        parts += [_entry(one, getattr(module, one), 3) for one in module.__all__]
    return "\n".join(parts)


def _entry(name: str, thing: Callable[..., object], level: int) -> str:
    head = f"{'#' * level} `{name}`\n"
    if inspect.ismodule(thing):  # zenoh_cbef.scenario is the function, too
        thing = scenario
    if not getattr(thing, "__module__", "").startswith("zenoh_cbef"):
        return f"{head}\n`{str(thing).replace('~', '')}`\n"  # a name for a type of NumPy
    if inspect.isclass(thing):
        return "\n".join([head, _signature(name, thing), _doc(thing), "", *_members(name, thing, level)])
    return "\n".join([head, _signature(name, thing), _doc(thing), ""])


def _members(name: str, cls: type, level: int) -> Iterator[str]:
    """Public methods, properties and fields of a class that this package defines."""
    fields = inspect.get_annotations(cls)
    for one, member in list(vars(cls).items()):
        plain = getattr(member, "__func__", member)
        if one.startswith("_") or one in fields:
            continue
        if callable(plain):
            yield _entry(f"{name}.{one}", plain, level + 1)
        elif isinstance(member, property) or hasattr(member, "func"):
            yield f"{'#' * (level + 1)} `{name}.{one}`\n\n{_doc(getattr(member, 'fget', None) or member.func)}\n"


def _signature(name: str, thing: Callable[..., object]) -> str:
    if getattr(thing, "_is_protocol", False) or (inspect.isclass(thing) and issubclass(thing, Exception)):
        return ""
    plain = _FUNCTION.sub("...", _QUOTED.sub(r"\1", str(inspect.signature(thing))))
    return f"```python\n{name}{plain}\n```\n"


def _doc(thing: object) -> str:
    return inspect.getdoc(thing) or ""
