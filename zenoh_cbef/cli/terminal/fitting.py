"""Tables that never cut a number or a name: where a terminal is too narrow, rows become paragraphs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

_WIDE = 10_000


class Told(Text):
    """A cell that names its quantity itself: away from its column it needs no head."""


@dataclass(frozen=True)
class Fitting:
    """A table as it is where it fits, else with less padding and then without, else its rows one below the other.

    A row is then its first cell, and below it what the others say.
    """

    table: Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the table, or its rows."""
        table = self.table
        for column in table.columns:
            column.no_wrap = True
        padding = table.padding
        try:
            # Without lines between the columns only padding keeps the numbers apart; one side of it is better than no.
            for narrower in ((0, 1, 0, 0), 0) if table.box is not None else ():
                if not self._fits(console, options):
                    table.padding = narrower
            yield from _around(table, [table] if self._fits(console, options) else list(self._rows(console)))
        finally:
            table.padding = padding

    def _fits(self, console: Console, options: ConsoleOptions) -> bool:
        # Measured as wide as it wants to be, without title and caption, which may take several lines.
        return Measurement.get(console, options.update(max_width=_WIDE), self.table).maximum <= options.max_width

    def _rows(self, console: Console) -> Iterator[RenderableType]:
        heads = [_text(console, column.header) for column in self.table.columns]
        for row in zip(*(column.cells for column in self.table.columns), strict=True):
            first, *others = zip(heads, row, strict=True)
            yield Text(" ").join(one for one in (first[0], _text(console, first[1])) if one.plain)
            said = [_said(head, _text(console, cell), alone=isinstance(cell, Told)) for head, cell in others]
            if any(one.plain for one in said):
                yield Padding(Text("; ").join(one for one in said if one.plain), (0, 0, 0, 2))


def _said(head: Text, cell: Text, *, alone: bool) -> Text:
    if alone or not head.plain or not cell.plain:
        return cell
    return Text(": ").join((head, cell))


def _around(table: Table, inside: list[RenderableType]) -> Iterator[RenderableType]:
    """A table's title above, its caption below, in as many lines as they need."""
    title, caption = table.title, table.caption
    table.title = table.caption = None
    try:
        if title:
            yield _plain(title)
        yield from inside
        if caption:
            yield _plain(caption)
    finally:
        table.title, table.caption = title, caption


def _plain(words: RenderableType) -> Text:
    return words if isinstance(words, Text) else Text(str(words), style="italic")


def _text(console: Console, cell: RenderableType) -> Text:
    return cell.copy() if isinstance(cell, Text) else console.render_str(str(cell), highlight=False)
