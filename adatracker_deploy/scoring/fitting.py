"""A table that never truncates a number: in a narrow terminal it omits whole columns and says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich import box
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console, ConsoleOptions, RenderResult


@dataclass(frozen=True, slots=True, kw_only=True)
class FittingTable:
    """Rows of text under names, drawn with as many columns as the terminal has room for."""

    names: Sequence[str]
    rows: Sequence[Sequence[str]]
    expendable: Sequence[str]
    """Columns that may be left out, the first first."""
    left: Sequence[str] = ()
    """Columns of words, which stand at the left; numbers stand at the right."""
    bold: Sequence[bool] = ()
    """Rows to be set off; none by default."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Give the widest table that fits; where none does, the narrowest, its cells in lines."""
        gone: list[str] = []
        for name in (None, *self.expendable):
            gone += [] if name is None else [name]
            table = self._table(gone, broken=False)
            if Measurement.get(console, options.update(max_width=10_000), table).maximum <= options.max_width:
                break
        else:
            table = self._table(gone, broken=True)
        yield table
        if gone:
            yield Text(f"  not shown at this width: {', '.join(name for name in self.names if name in gone)}")

    def _table(self, without: Sequence[str], *, broken: bool) -> Table:
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
        shown = [place for place, name in enumerate(self.names) if name not in without]
        for place in shown:
            name = self.names[place]
            table.add_column(
                name, justify="left" if name in self.left else "right", no_wrap=not broken, overflow="fold"
            )
        for number, row in enumerate(self.rows):
            style = "bold" if self.bold and self.bold[number] else ""
            table.add_row(*(Text(row[place]) for place in shown), style=style)
        return table
