"""Modules of this folder as one script for an HTML file that opens without a server, where modules cannot be loaded."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

_IMPORT = re.compile(r'^import .* from "\./([a-z]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ", re.MULTILINE)


@cache
def bundled(name: str) -> str:
    """The script of a module of `scene/` after those that it imports, each once; their names must differ."""
    found: dict[str, str] = {}
    _take(name, found)
    return "\n".join(found.values())


def _take(name: str, found: dict[str, str]) -> None:
    text = (files("zenoh_cbef.pages") / "scene" / name).read_text(encoding="utf-8")
    for other in _IMPORT.findall(text):
        if other not in found:
            _take(other, found)
    found[name] = _EXPORT.sub("", _IMPORT.sub("", text))
