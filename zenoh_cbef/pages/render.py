"""Fills the templates of this folder. They escape every value, and a page loads nothing from outside."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING

from zenoh_cbef.pages.bundle import bundled
from zenoh_cbef.pages.packing import enclosed

if TYPE_CHECKING:
    from jinja2 import Environment


def render(template: str, /, **values: object) -> str:
    """The text of a template with its values."""
    return _environment().get_template(template).render(values)


@lru_cache(maxsize=1)
def _library(text: str) -> str:
    """Text as `enclosed`: plotly.js, which is the same in all pages of a process and takes longer than all else."""
    return enclosed(text.encode())


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - time that only pages should cost

    loader = PackageLoader("zenoh_cbef", "pages")
    found = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    found.filters["at"] = "{:.1f}".format
    found.filters["enclosed"] = lambda given: _library(given) if isinstance(given, str) else enclosed(given)
    found.globals["bundled"] = bundled
    found.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    return found
