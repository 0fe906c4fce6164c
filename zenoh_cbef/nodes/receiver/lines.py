"""The lines that receivers write, as ranges: a form is a function, and a line of FORMS."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping

from zenoh_cbef.nodes.receiver.ranged import Found, Ranged, plausible

_LONGEST = 1 << 16


def comma_separated(line: str) -> list[Ranged]:
    """A range a line, `t,anchor,range`, in s and m; anything else is no range."""
    values = [value.strip() for value in line.split(",")]
    try:
        return [Ranged(float(values[0]), values[1], float(values[2]))] if len(values) == 3 else []
    except ValueError:
        return []


def json_lines(line: str) -> list[Ranged]:
    """A range a line, `{"t": 1.5, "anchor": "a", "range": 3.2}`; t may be left out."""
    try:
        told = json.loads(line)
        return [Ranged(None if told.get("t") is None else float(told["t"]), str(told["anchor"]), float(told["range"]))]
    except (ValueError, KeyError, TypeError, AttributeError):
        return []


_LES = re.compile(r"([0-9A-Fa-f]{4})\[[^\]]*\]=(\d+(?:\.\d+)?)")
_LEC = re.compile(r"AN\d+,([0-9A-Fa-f]{4}),[^,]+,[^,]+,[^,]+,(\d+(?:\.\d+)?)")


def dwm1001(line: str) -> list[Ranged]:
    """The shell of a DWM1001 tag: `les` as in 0C16[0.00,0.00,2.00]=3.21, `lec` as in DIST,1,AN0,0C16,0,0,2,3.21."""
    shape = _LEC if line.startswith("DIST") else _LES
    return [Ranged(None, name.upper(), float(distance)) for name, distance in shape.findall(line)]


FORMS: Mapping[str, Callable[[str], list[Ranged]]] = {"csv": comma_separated, "json": json_lines, "dwm1001": dwm1001}


def ranges_in(line: str, form: str) -> list[Ranged]:
    """The ranges of a line; form: one of FORMS, or auto for whichever finds any. Lengths below zero are left out."""
    line = line.strip().removeprefix("\ufeff")
    for read in FORMS.values() if form == "auto" else [FORMS[form]]:
        if found := plausible(read(line)):
            return found
    return []


class Lines:
    """Finds ranges in lines of text. form: one of FORMS, or auto."""

    def __init__(self, form: str) -> None:
        self._form, self._rest = form, b""

    def feed(self, data: bytes) -> Found:
        """The ranges of all lines that are complete."""
        *whole, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-_LONGEST:]
        each = [ranges_in(line.decode(errors="replace"), self._form) for line in whole]
        return Found([one for found in each for one in found], each.count([]))

    def finish(self) -> Found:
        """The last line needs no end."""
        return self.feed(b"\n") if self._rest else Found([], 0)

    def forget(self) -> None:
        """A line that has begun is lost."""
        self._rest = b""
