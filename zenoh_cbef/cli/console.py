"""Where verbs print: results on standard output, everything else on standard error."""

from __future__ import annotations

from rich.console import Console

console = Console()
errors = Console(stderr=True)


def number(value: float | None, unit: str = "") -> str:
    """A number in four significant digits; a dash where there is none."""
    if value is None:
        return "-"
    return f"{value:.4g}" + (f" {unit}" if unit else "")
