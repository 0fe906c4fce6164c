"""What verbs tell of a recording."""

from __future__ import annotations

from rich.table import Table

from zenoh_cbef.cli.terminal.console import warn
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.datasets import Dataset
from zenoh_cbef.datasets.findings import findings, summary


def summary_table(name: str, dataset: Dataset) -> Fitting:
    """What a recording holds."""
    table = Table(title=name, title_justify="left", show_header=False)
    for quantity, words in summary(dataset).items():
        table.add_row(quantity, words)
    return Fitting(table)


def tell_findings(dataset: Dataset) -> list[str]:
    """Print what is odd about a recording; returns it."""
    found = findings(dataset)
    warn(found)
    return found
