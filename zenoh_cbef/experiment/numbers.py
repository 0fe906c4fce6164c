"""The numbers that runs of an experiment have, by name: known from the types of metrics, before any run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from types import UnionType
from typing import get_args, get_type_hints

from zenoh_cbef.analysis.results import Metrics, Standing
from zenoh_cbef.errors import UserError
from zenoh_cbef.tracking.status import STATUSES
from zenoh_cbef.words import meant

SUMMED = ("sent", "delivered", "lost", "late", "injected_lost", "injected_late", "corrupted", "duplicated")
"""Counts of links, each summed over all links."""
_FINAL = ("position_rmse", "ratio_to_centralized", "disagreement")


@cache
def numbers() -> frozenset[str]:
    """All of them, also those that only some scenarios have."""
    links = {f"links.{name}" for name in (*SUMMED, "missed")}
    return frozenset(_numbers(Metrics)) - {"seed"} | links | {f"final.{name}" for name in _FINAL}


def _numbers(kind: type, above: str = "") -> Iterator[str]:
    for name, hint in get_type_hints(kind).items():
        choices = get_args(hint) if isinstance(hint, UnionType) else (hint,)
        if int in choices or float in choices:
            yield above + name
        for one in choices:
            if isinstance(one, type) and is_dataclass(one):
                yield from _numbers(one, f"{above}{name}.")
            elif one == dict[str, Standing]:
                for status in STATUSES:
                    yield from _numbers(Standing, f"{above}{name}.{status}.")


def check_number(name: str, key: str) -> None:
    """Raise UserError where no run can have a number of this name; key: what names it."""
    if name not in numbers():
        parts = sorted((one for one in sorted(numbers()) if name in one.split(".")), key=lambda one: one.index(name))
        near = meant(
            parts[0] if parts else name, sorted(numbers()), "docs/log-format.md has their names, as position_rmse"
        )
        raise UserError(f"{key} {name!r} is no number that runs have; {near}")
