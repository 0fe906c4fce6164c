"""What --table prints."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from typing import Annotated

import typer

from zenoh_cbef.analysis.typeset import comma_separated, latex
from zenoh_cbef.pages.parts import Table


class Typesetting(StrEnum):
    """How a table is printed for a paper."""

    latex = "latex"
    csv = "csv"

    def text(self, table: Table) -> str:
        """The table; LaTeX says in a comment which command made it."""
        if self is Typesetting.csv:
            return comma_separated(table)
        return latex(table, shlex.join(["zenoh-cbef", *sys.argv[1:]]))


AsTable = Annotated[Typesetting | None, typer.Option("--table", help="Print the table for a paper instead.")]
